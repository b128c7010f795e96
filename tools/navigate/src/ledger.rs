//! What long suites add up to: a file with one account for each arbiter, mapper, robot and way of seeing, and in it one for
//! each driver.

use crate::error::NavigateError;
use serde::{Deserialize, Serialize};
use sidestep_report::{Proportion, rate_at_most};
use std::collections::BTreeMap;
use std::path::Path;

/// Everything ever driven, by what drove.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Ledger {
    /// One for each arbiter, robot, way of seeing and seed.
    pub accounts: Vec<Account>,
}

/// What one arbiter drove.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Account {
    /// Fingerprint of how arbiter, robot and what it sees by behave ([`crate::behaviour`]), in hexadecimal; the network's
    /// weights are left out, so that a new model goes on with the kilometres of the old one.
    pub behaviour: String,
    /// How the robot saw.
    pub sight: String,
    /// Seed of the rooms.
    pub seed: u64,
    /// Number of the next room.
    pub next: u64,
    /// By driver.
    pub drivers: BTreeMap<String, Tally>,
}

/// What one driver did.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Tally {
    /// Rooms entered.
    pub drives: u64,
    /// Of them crossed in time without contact.
    pub reached: u64,
    /// `[m]` way driven.
    pub distance_m: f64,
    /// `[s]` time driven.
    pub time_s: f64,
    /// Places at which the filter kept the robot standing for half a second against a wish to drive on.
    pub stops: u64,
    /// Of them those where nothing stood in the tube of the wish.
    pub false_stops: u64,
    /// Numbers of the rooms that a lead did not cross in time, to be driven again.
    pub late: Vec<u64>,
    /// Numbers of the rooms in which a lead had a false stop.
    pub held_up: Vec<u64>,
    /// Every contact.
    pub contacts: Vec<Contact>,
}

/// A contact, to be driven again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Contact {
    /// Number of the room within the seed.
    pub room: u64,
    /// `[s]` after the start.
    pub time_s: f64,
    /// `[m]` where.
    pub at_m: [f64; 2],
    /// In words.
    pub summary: String,
}

impl Ledger {
    /// Reads a file; an absent one is an empty ledger.
    ///
    /// # Errors
    /// [`NavigateError::Ledger`] where it cannot be read or is none.
    pub fn read(path: &Path) -> Result<Self, NavigateError> {
        let unfit = |detail: String| NavigateError::Ledger { path: path.display().to_string(), detail };
        match std::fs::read_to_string(path) {
            Ok(text) => serde_json::from_str(&text).map_err(|error| unfit(error.to_string())),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Self::default()),
            Err(error) => Err(unfit(error.to_string())),
        }
    }

    /// Writes the file in one move: a kill leaves the old one or the new one.
    ///
    /// # Errors
    /// [`NavigateError::Ledger`] where the disk refuses.
    pub fn write(&self, path: &Path) -> Result<(), NavigateError> {
        let beside = path.with_extension("part");
        let text = serde_json::to_string_pretty(self)?;
        let kept = std::fs::write(&beside, text + "\n").and_then(|()| std::fs::rename(&beside, path));
        kept.map_err(|error| NavigateError::Ledger {
            path: path.display().to_string(),
            detail: error.to_string(),
        })
    }

    /// The account of a behaviour, opened where there is none yet.
    pub fn account(&mut self, behaviour: &str, sight: &str, seed: u64) -> &mut Account {
        let same = |account: &Account| {
            account.behaviour == behaviour && account.sight == sight && account.seed == seed
        };
        let place = self.accounts.iter().position(same).unwrap_or_else(|| {
            let (behaviour, sight) = (behaviour.to_owned(), sight.to_owned());
            self.accounts.push(Account { behaviour, sight, seed, next: 0, drivers: BTreeMap::new() });
            self.accounts.len() - 1
        });
        &mut self.accounts[place]
    }
}

impl Account {
    /// `[m]` way of all drivers.
    #[must_use]
    pub fn distance_m(&self) -> f64 {
        self.drivers.values().map(|tally| tally.distance_m).sum()
    }

    /// One line: all drivers together, with the upper 95 % bound of contacts per kilometre.
    #[must_use]
    pub fn line(&self) -> String {
        let (km, contacts) = (self.distance_m() / 1000.0, self.contacts());
        format!(
            "{km:.2} km, {contacts} contacts, at most {:.3} per km",
            rate_at_most(contacts) / km.max(1e-3)
        )
    }

    /// Contacts of all drivers.
    #[must_use]
    pub fn contacts(&self) -> u64 {
        self.drivers.values().map(|tally| tally.contacts.len() as u64).sum()
    }
}

impl Tally {
    /// One line: what a driver did, with the upper 95 % bound of contacts per kilometre.
    #[must_use]
    pub fn line(&self) -> String {
        if self.drives == 0 {
            return "nothing driven yet".into();
        }
        let km = (self.distance_m / 1000.0).max(1e-3);
        format!(
            "{:.2} km, reached {}, {:.2} m/s, {:.2} stops and {:.2} false ones per km, {} contacts, at most {:.2} per km",
            self.distance_m / 1000.0,
            Proportion::new(self.reached, self.drives).text(),
            self.distance_m / self.time_s.max(1e-9),
            self.stops as f64 / km,
            self.false_stops as f64 / km,
            self.contacts.len(),
            rate_at_most(self.contacts.len() as u64) / km
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The kilometres that the README tells of: nothing was touched, under every driver, and each drove its share.
    #[test]
    fn the_account_of_the_readme_holds_no_contact() {
        let ledger: Ledger = serde_json::from_str(include_str!("../ledger.json")).unwrap();
        for account in &ledger.accounts {
            println!("{} {} {}", account.behaviour, account.sight, account.line());
            assert_eq!(account.contacts(), 0);
            for (driver, tally) in &account.drivers {
                assert!(tally.distance_m > 0.15 * account.distance_m(), "{driver}: {}", tally.line());
            }
        }
    }

    #[test]
    fn a_ledger_is_what_was_written_and_keeps_accounts_apart() {
        let path = std::env::temp_dir().join(format!("sidestep-ledger-{}.json", std::process::id()));
        let mut ledger = Ledger::read(&path).unwrap();
        ledger.account("a", "grid", 1).next = 7;
        ledger.account("b", "grid", 1).next = 9;
        assert_eq!(ledger.account("a", "grid", 1).next, 7);
        ledger.account("a", "camera", 1);
        ledger.write(&path).unwrap();
        assert_eq!(Ledger::read(&path).unwrap(), ledger);
        assert_eq!(ledger.accounts.len(), 3);
        std::fs::write(&path, "{\"accounts\": 3}").unwrap();
        let error = Ledger::read(&path).unwrap_err().to_string();
        assert!(error.contains("invalid type") && error.contains("name another with --ledger"), "{error}");
        std::fs::remove_file(&path).unwrap();
        assert!(ledger.write(&path.join("absent/x.json")).unwrap_err().to_string().contains("absent"));
    }
}

//! A comparison in a terminal.

use crate::comparison::{Comparison, Read};
use std::fmt::Write as _;

// A text in memory cannot fail to take more text: the results of `write!` carry nothing here.

impl Comparison {
    /// The figures as text for a person.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = String::new();
        self.heading(&mut text);
        self.errors(&mut text);
        self.costs(&mut text);
        self.recordings.iter().for_each(|read| conduct(&mut text, read));
        let worst: Vec<_> = self
            .worst
            .iter()
            .take(5)
            .map(|shown| format!("{:.2} s (frame {})", shown.time_s, shown.frame))
            .collect();
        let worst = if worst.is_empty() { "none above 0".into() } else { worst.join(", ") };
        let _ = writeln!(text, "worst        {worst}");
        text
    }

    fn heading(&self, text: &mut String) {
        for read in &self.recordings {
            let origin = &read.origin;
            let state = origin.damage.as_ref().map_or(String::new(), |damage| format!(", cut: {damage}"));
            let _ = writeln!(
                text,
                "{}: {:.1} s, lead {}, model {}, expert {}{state}",
                origin.file, origin.duration_s, origin.lead, origin.model, origin.expert
            );
        }
        let [first, second] = &self.names;
        let _ = writeln!(text, "{first} against {second} on {} frames", self.figures.frames);
        if self.seen_differently > 0 {
            let count = self.seen_differently;
            let _ = writeln!(text, "left out: {count} frames on which the two saw different maps");
        }
    }

    fn errors(&self, text: &mut String) {
        let _ = writeln!(text, "\nwindow [s]  |v| [m/s] mean    std  |w| [rad/s] mean    std  norm mean");
        for window in &self.figures.windows {
            let e = &window.errors;
            let _ = writeln!(
                text,
                "{:>10.1} {:>16.4} {:>6.4} {:>18.4} {:>6.4} {:>10.4}",
                window.window_s, e.v_mean, e.v_std, e.w_mean, e.w_std, e.l2_mean
            );
        }
        let agreement = &self.figures.agreement;
        let _ = writeln!(
            text,
            "\nagreement    {:.1} % of frames within {} m/s and {} rad/s",
            100.0 * agreement.share,
            agreement.v_m_s,
            agreement.w_rad_s
        );
    }

    fn costs(&self, text: &mut String) {
        let r = &self.figures.regret;
        let _ = writeln!(
            text,
            "cost J       mean {:.3} and {:.3}, above the optimum {:.3} and {:.3}\n\
             regret dJ    mean {:.3}, p50 {:.3}, p90 {:.3}, p99 {:.3}, max {:.3}",
            r.costs[0], r.costs[1], r.gaps[0], r.gaps[1], r.mean, r.p50, r.p90, r.p99, r.max
        );
        if let Some(part) = self.figures.doubt_catches {
            let percent = 100.0 * part;
            let _ = writeln!(
                text,
                "doubt        the tenth of most doubt holds {percent:.0} % of the disagreements"
            );
        }
    }
}

fn conduct(text: &mut String, read: &Read) {
    let conduct = &read.conduct;
    let winners: Vec<_> =
        conduct.winners.iter().map(|(name, time)| format!("{name} {:.1} s", time.total_s)).collect();
    let _ = writeln!(
        text,
        "drove        {}; {} changes of the winner, {:.2} s changed by the arbiter",
        winners.join(", "),
        conduct.takeover_count(),
        conduct.changed_s().max(0.0)
    );
    if let Some(outcome) = &conduct.outcome {
        let _ = writeln!(
            text,
            "truth        {:.1} m, {} goals reached, {} contacts, nearest {:.2} m",
            outcome.distance_m, outcome.arrivals, outcome.contacts, outcome.min_clearance_m
        );
    }
}

//! A comparison in a terminal.

use crate::comparison::Comparison;
use std::fmt::Write as _;

impl Comparison {
    /// The figures as text for a person.
    #[must_use]
    pub fn text(&self) -> String {
        let [first, second] = &self.names;
        let figures = &self.figures;
        let mut text = String::new();
        // A text in memory cannot fail to take more text.
        for read in &self.recordings {
            let origin = &read.origin;
            let state = origin.damage.as_ref().map_or(String::new(), |damage| format!(", cut: {damage}"));
            let _ = writeln!(
                text,
                "{}: {:.1} s, lead {}, model {}, expert {}{state}",
                origin.file, origin.duration_s, origin.lead, origin.model, origin.expert
            );
        }
        let _ = writeln!(text, "{first} against {second} on {} frames", figures.frames);
        if self.seen_differently > 0 {
            let _ = writeln!(
                text,
                "left out: {} frames on which the two saw different maps",
                self.seen_differently
            );
        }
        let _ = writeln!(text, "\nwindow [s]  |v| [m/s] mean    std  |w| [rad/s] mean    std  norm mean");
        for window in &figures.windows {
            let errors = &window.errors;
            let _ = writeln!(
                text,
                "{:>10.1} {:>16.4} {:>6.4} {:>18.4} {:>6.4} {:>10.4}",
                window.window_s, errors.v_mean, errors.v_std, errors.w_mean, errors.w_std, errors.l2_mean
            );
        }
        let (agreement, regret) = (&figures.agreement, &figures.regret);
        let _ = writeln!(
            text,
            "\nagreement    {:.1} % of frames within {} m/s and {} rad/s",
            100.0 * agreement.share,
            agreement.v_m_s,
            agreement.w_rad_s
        );
        let _ = writeln!(
            text,
            "cost J       mean {:.3} and {:.3}, above the optimum {:.3} and {:.3}\n\
             regret dJ    mean {:.3}, p50 {:.3}, p90 {:.3}, p99 {:.3}, max {:.3}",
            regret.costs[0],
            regret.costs[1],
            regret.gaps[0],
            regret.gaps[1],
            regret.mean,
            regret.p50,
            regret.p90,
            regret.p99,
            regret.max
        );
        if let Some(part) = figures.doubt_catches {
            let _ = writeln!(
                text,
                "doubt        the tenth of most doubt holds {:.0} % of the disagreements",
                100.0 * part
            );
        }
        for read in &self.recordings {
            let conduct = &read.conduct;
            let winners: Vec<_> =
                conduct.winners.iter().map(|(name, time)| format!("{name} {:.1} s", time.total_s)).collect();
            let _ = writeln!(
                text,
                "drove        {}; {} changes of the winner, {:.2} s changed by the arbiter",
                winners.join(", "),
                conduct.takeover_count(),
                conduct.changed_s()
            );
            if let Some(outcome) = &conduct.outcome {
                let _ = writeln!(
                    text,
                    "truth        {:.1} m, {} goals reached, {} contacts, nearest {:.2} m",
                    outcome.distance_m, outcome.arrivals, outcome.contacts, outcome.min_clearance_m
                );
            }
        }
        let worst: Vec<_> = self
            .worst
            .iter()
            .take(5)
            .map(|shown| format!("{:.2} s (frame {})", shown.time_s, shown.frame))
            .collect();
        let _ = writeln!(text, "worst        {}", worst.join(", "));
        text
    }
}

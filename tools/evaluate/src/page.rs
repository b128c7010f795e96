//! The report: the paper's numbers with their machine and year, and ours beside them.

use crate::doubt::Axis;
use crate::error::EvaluateError;
use crate::evaluation::Evaluation;
use crate::plots;
use crate::table1::SetTable;
use sidestep_msgs::Robot;
use sidestep_report::{Figure, Report, Table};
use sidestep_train::Errors;

/// Where the paper's times come from.
const PAPER_MACHINE: &str = "paper, Atom Z8750 of the robot, 2018";

impl Evaluation {
    /// Draws the report.
    ///
    /// # Errors
    /// [`EvaluateError::Report`] where a picture cannot be drawn.
    pub fn report(&self, robot: &Robot) -> Result<Report, EvaluateError> {
        let subtitle = format!(
            "model {:016x}, {} samples seen, datasets {:016x}, robot {}",
            self.model_hash, self.trained.0, self.trained.1, robot.name
        );
        let mut report = Report::new("The policy, frame by frame", &subtitle, self.json());
        self.tiles(&mut report);
        report.heading("Table I: prediction error");
        report.paragraph(
            "A command lies within u' +- acceleration x window. The paper names neither window nor noise of its labels; \
             0.1 s is one of its control periods. `random` is data of the worlds of the training that training left out; \
             `by world` is data of other worlds. The noise of a label is its distance to the solved one.",
        );
        report.table(&self.table1());
        report.table(&self.details());
        report.heading("Fig. 3: single frames of other worlds");
        let cases: Result<Vec<_>, _> = self.cases.iter().map(|case| plots::case(case, robot)).collect();
        report.figures(&cases?, 2);
        report.heading("Fig. 5: how errors are spread");
        report.figures(&[plots::spreads(self)], 2);
        report.heading("Fig. 6: time and optimality gap");
        report.figure(&plots::times(self));
        report.table(&self.times());
        report.figure(&plots::gaps(self, false));
        report.figure(&plots::gaps(self, true));
        report.paragraph(
            "The gap is the mean norm of the difference of two emitted commands. `First candidates` are the beginning of \
             the demonstrator's own sequence (nested), `other candidates` a stretch of it that the demonstrator does not \
             hold: a set that holds the answer is near to it by chance. The model learned the solved labels.",
        );
        report.table(&self.gap_table());
        report.table(&self.regret_table());
        report.heading("Doubt");
        for (name, doubt) in &self.doubts {
            report.figures(&plots::reliability(name, doubt), 2);
        }
        report.table(&self.doubt_table());
        report.heading("Table II: kinds of methods");
        report.table(&self.table2());
        Ok(report)
    }

    /// The main pictures as one: single frames, and the gap beside that of sets of candidates.
    ///
    /// # Errors
    /// [`EvaluateError::Report`] where a picture cannot be drawn.
    pub fn overview(&self, robot: &Robot) -> Result<Figure, EvaluateError> {
        let cases: Result<Vec<_>, _> =
            self.cases.iter().take(3).map(|case| plots::case(case, robot)).collect();
        let cases = Figure::sheet("Frames of other worlds, by error", &cases?, 3);
        let all = [cases, plots::gaps(self, false), plots::gaps(self, true)];
        Ok(Figure::stack("The policy, frame by frame", &all))
    }

    fn tiles(&self, report: &mut Report) {
        let mut tiles = Vec::new();
        if let Some(test) = self.table("by_world.test") {
            let errors = test.solved.windows.first().map(|window| window.errors).unwrap_or_default();
            tiles.push((format!("{:.4} m/s", errors.v_mean), "error of v, other worlds".to_owned()));
            tiles.push((format!("{:.4} rad/s", errors.w_mean), "error of w, other worlds".to_owned()));
        }
        let equal = |count: Option<f64>, most: &str| count.map_or(most.into(), |count| format!("{count:.0}"));
        let equals = &self.equals;
        tiles
            .push((equal(equals.demonstrator[0], "over 734"), "candidates, against the demonstrator".into()));
        tiles.push((equal(equals.solved[0], "over 10000"), "candidates, against the optimum".into()));
        tiles.push((format!("{:.0} us", self.timing.policy_us), "one answer".into()));
        report.tiles(&tiles);
    }

    fn table1(&self) -> Table {
        let mut table = Table::new(
            "Mean and standard deviation of the absolute error, window 0.1 s",
            &[("set", ""), ("label", ""), ("v", "m/s"), ("v std", "m/s"), ("w", "rad/s"), ("w std", "rad/s")],
        );
        for (name, row) in [
            ("paper, train, 2018", ["0.0031", "0.0050", "0.0115", "0.0132"]),
            ("paper, test, 2018", ["0.0037", "0.0079", "0.0151", "0.0308"]),
        ] {
            table.row([name, "734 candidates"].into_iter().chain(row));
        }
        for (name, set) in &self.tables {
            for (label, labels) in [("solved", &set.solved), ("734 candidates", &set.plain)] {
                let errors = labels.windows.first().map(|window| window.errors).unwrap_or_default();
                table.row([name.replace(['.', '_'], " "), label.into()].into_iter().chain(cells(&errors)));
            }
            let noise = set.label_noise.first().copied().unwrap_or_default();
            let what = "noise of 734".to_owned();
            table.row([name.replace(['.', '_'], " "), what].into_iter().chain(cells(&noise)));
        }
        table
    }

    fn details(&self) -> Table {
        let mut table = Table::new(
            "The same by window: norm, mean squared norm, part of the error of keeping u' that is taken away, part of \
             the labels at an edge of the window",
            &[
                ("set", ""),
                ("label", ""),
                ("window", "s"),
                ("v", "m/s"),
                ("w", "rad/s"),
                ("norm", ""),
                ("squared", ""),
                ("skill", "%"),
                ("v at edge", "%"),
                ("w at edge", "%"),
            ],
        );
        for (name, set) in &self.tables {
            for (label, labels) in [("solved", &set.solved), ("734 candidates", &set.plain)] {
                for window in &labels.windows {
                    let errors = &window.errors;
                    table.row([
                        name.replace(['.', '_'], " "),
                        label.into(),
                        format!("{:.1}", window.window_s),
                        format!("{:.4}", errors.v_mean),
                        format!("{:.4}", errors.w_mean),
                        format!("{:.4}", errors.l2_mean),
                        format!("{:.5}", errors.l2_squared_mean),
                        format!("{:.1}", 100.0 * window.skill),
                        format!("{:.1}", 100.0 * window.saturated[0]),
                        format!("{:.1}", 100.0 * window.saturated[1]),
                    ]);
                }
            }
        }
        table
    }

    fn times(&self) -> Table {
        let mut table = Table::new("Median time of one answer, one core", &[("what", ""), ("time", "us")]);
        table.row([format!("policy ({PAPER_MACHINE})"), "44000".to_owned()]);
        table.row([format!("250 candidates ({PAPER_MACHINE})"), "80000".to_owned()]);
        let timing = &self.timing;
        table.row(["policy".to_owned(), format!("{:.1}", timing.policy_us)]);
        table.row(["policy, plain tract".to_owned(), format!("{:.0}", timing.plain_tract_us)]);
        let peer = timing.onnxruntime_us.map_or("not installed".into(), |us| format!("{us:.0}"));
        table.row(["policy, onnxruntime".to_owned(), peer]);
        for (count, us) in &timing.candidates {
            table.row([format!("{count} candidates"), format!("{us:.1}")]);
        }
        table.row(["solved".to_owned(), format!("{:.1}", timing.solved_us)]);
        table.row(["refined, after the policy".to_owned(), format!("{:.1}", timing.refined_us)]);
        table
    }

    fn gap_table(&self) -> Table {
        let mut table = Table::new(
            "As near as how many first candidates? Paper: 270 (demonstrator, window not named)",
            &[
                ("baseline", ""),
                ("window", "s"),
                ("gap of the policy", ""),
                ("squared", ""),
                ("candidates", ""),
            ],
        );
        let shown = |count: Option<f64>, most: &str| count.map_or(most.into(), |count| format!("{count:.0}"));
        for (index, window) in ["0.1", "0.3"].into_iter().enumerate() {
            for (name, gap, squared, count) in [
                (
                    "734 candidates",
                    self.gap.demonstrator[index],
                    self.gap.demonstrator_squared[index],
                    shown(self.equals.demonstrator[index], "over 734"),
                ),
                (
                    "734 candidates, beside candidates that it does not hold",
                    self.gap.demonstrator[index],
                    self.gap.demonstrator_squared[index],
                    shown(self.equals.demonstrator_apart[index], "over 10000"),
                ),
                (
                    "solved",
                    self.gap.solved[index],
                    self.gap.solved_squared[index],
                    shown(self.equals.solved[index], "over 10000"),
                ),
            ] {
                table.row([
                    name.to_owned(),
                    window.into(),
                    format!("{gap:.4}"),
                    format!("{squared:.5}"),
                    count,
                ]);
            }
        }
        table
    }

    fn regret_table(&self) -> Table {
        let mut table = Table::new(
            "J of eq. (6) of the best plan that begins with the emitted command, above the solved plan",
            &[("lead", ""), ("mean", ""), ("90 of 100", ""), ("99 of 100", "")],
        );
        for (name, regret) in ["policy", "refined", "734 candidates"].into_iter().zip(&self.regrets) {
            let cells = [regret.mean, regret.p90, regret.p99].map(|value| format!("{value:.3}"));
            table.row([name.to_owned()].into_iter().chain(cells));
        }
        let oracle = &self.oracle;
        let name = format!("solved, above the best with free knots ({} frames)", oracle.frames);
        table.row([name, format!("{:.3}", oracle.gap), "-".into(), "-".into()]);
        table
    }

    fn doubt_table(&self) -> Table {
        let mut table = Table::new(
            "Doubt against errors, window 0.3 s",
            &[
                ("set", ""),
                ("axis", ""),
                ("large from", ""),
                ("large", "%"),
                ("AUROC", ""),
                ("calibration error", ""),
            ],
        );
        for (name, doubt) in &self.doubts {
            for (axis, unit, of) in [("v", "m/s", &doubt.v), ("w", "rad/s", &doubt.w)] {
                let Axis { large, large_share, auroc, calibration_error, .. } = of;
                table.row([
                    name.replace(['.', '_'], " "),
                    axis.into(),
                    format!("{large} {unit}"),
                    format!("{:.1}", 100.0 * large_share),
                    auroc.map_or("-".into(), |auroc| format!("{auroc:.3}")),
                    format!("{calibration_error:.4} {unit}"),
                ]);
            }
        }
        table
    }

    /// The paper's table with what is measured here in a line of its own.
    fn table2(&self) -> Table {
        let mut table = Table::new(
            "After the paper's Table II; the last two rows are measured here",
            &[("", ""), ("map IL (VIN)", ""), ("E2E IL (CNN)", ""), ("optimisation (sampling)", "")],
        );
        for row in [
            ["training data", "experiments + generated", "experiments", "none"],
            ["sensor type", "generic", "specific", "generic"],
            ["policy optimality", "high", "medium", "low to high"],
            ["computation time", "short", "medium", "short to long"],
        ] {
            table.row(row);
        }
        let timing = &self.timing;
        let first = |count: usize| {
            timing.candidates.iter().find(|point| point.0 == count).map_or(0.0, |point| point.1)
        };
        table.row([
            "time here".to_owned(),
            format!("{:.0} us", timing.policy_us),
            "not built".into(),
            format!("{:.0} us (50) to {:.0} us (10000)", first(50), first(10_000)),
        ]);
        table.row([
            "J above the optimum here".to_owned(),
            format!("{:.3}", self.regrets[0].mean),
            "not built".into(),
            format!("{:.3} (734)", self.regrets[2].mean),
        ]);
        table
    }
}

fn cells(errors: &Errors) -> [String; 4] {
    [errors.v_mean, errors.v_std, errors.w_mean, errors.w_std].map(|value| format!("{value:.4}"))
}

/// Text for a terminal: Table I by world and what the model equals.
impl std::fmt::Display for Evaluation {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let line = |set: &SetTable| {
            let errors = set.solved.windows.first().map(|window| window.errors).unwrap_or_default();
            format!(
                "v {:.4} +- {:.4} m/s, w {:.4} +- {:.4} rad/s",
                errors.v_mean, errors.v_std, errors.w_mean, errors.w_std
            )
        };
        writeln!(out, "against the solved label, window 0.1 s:")?;
        for (name, set) in &self.tables {
            writeln!(out, "  {:14} {}  ({} records)", name.replace(['.', '_'], " "), line(set), set.samples)?;
        }
        let count =
            |count: Option<f64>| count.map_or("more than all tried".into(), |count| format!("{count:.0}"));
        writeln!(
            out,
            "equals {} candidates against the demonstrator ({} of its own), {} against the optimum",
            count(self.equals.demonstrator_apart[0]),
            count(self.equals.demonstrator[0]),
            count(self.equals.solved[0])
        )?;
        let [policy, refined, plain] = self.regrets.map(|regret| regret.mean);
        writeln!(
            out,
            "J above the optimum: policy {policy:.3}, refined {refined:.3}, 734 candidates {plain:.3}"
        )?;
        for (name, doubt) in &self.doubts {
            let shown = |auroc: Option<f64>| auroc.map_or("-".into(), |auroc| format!("{auroc:.3}"));
            let name = name.replace(['.', '_'], " ");
            writeln!(
                out,
                "AUROC of the doubt, {name}: v {}, w {}",
                shown(doubt.v.auroc),
                shown(doubt.w.auroc)
            )?;
        }
        write!(out, "one answer: {:.0} us", self.timing.policy_us)
    }
}

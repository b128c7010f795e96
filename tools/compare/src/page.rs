//! A comparison as a report, and its pictures.

use crate::comparison::Comparison;
use crate::conduct::{Conduct, Episodes, Stretch};
use crate::error::CompareError;
use crate::figures::Ages;
use crate::frames::{Point, Shown};
use crate::picture::INKS;
use sidestep_msgs::{Code, Reason, Winner};
use sidestep_report::{
    Axis, Bars, Boxes, Cloud, Figure, Ink, LinePlot, Report, ReportError, Scatter, Span, Spread, Strip, Table,
};
use sidestep_train::{Errors, LARGE_V_M_S, LARGE_W_RAD_S};
use std::collections::BTreeMap;

/// `[s]` a longer silence breaks a line.
const GAP_S: f64 = 0.5;

impl Comparison {
    /// The report, all in one page.
    ///
    /// # Errors
    /// Where a picture cannot be made.
    pub fn report(&self) -> Result<Report, CompareError> {
        let [first, second] = &self.names;
        let title = format!("{first} against {second}");
        let subtitle = self.recordings.iter().zip(["A: ", "B: "]).map(|(read, letter)| {
            let origin = &read.origin;
            format!(
                "{}{}, {:.0} s, robot {}, lead {}, model {}, expert {}",
                if self.recordings.len() > 1 { letter } else { "" },
                origin.file,
                origin.duration_s,
                origin.robot,
                origin.lead,
                origin.model,
                origin.expert
            )
        });
        let subtitle: Vec<_> = subtitle.collect();
        let mut report = Report::new(&title, &subtitle.join(". "), self.summary());
        self.warnings(&mut report);
        report.tiles(&self.tiles());
        report.heading("Over time");
        self.over_time().iter().for_each(|figure| report.figure(figure));
        report.heading("Errors and what they cost");
        report.paragraph(
            "Both proposals are velocities within reach of the robot's own; a narrower window compares what can be reached in \
             that time. The cost J is that of eq. (6) for the best plan that begins with a proposal, on the same map and goal; \
             regret dJ is the cost of the first above that of the second, the gap the cost above the least that is known (of the \
             solved plan or of one of the two). Messages carry what can be reached in 0.3 s; the raw targets are not recorded.",
        );
        report.table(&self.error_table());
        report.figures(&self.boxes(), 2);
        report.figures(&[self.regret_histogram(), self.doubt_scatter()], 2);
        report.heading("The worst frames");
        report.paragraph(
            "The planning cost that both saw (dark: above the limit; blue-grey: never seen), the goal (star), both velocities as \
             arrows of one second, the best plans that begin with them (dashed, 2.4 s), and what the arbiter commanded. \
             At most one per second of the drive.",
        );
        let pictures: Vec<_> =
            self.worst.iter().map(|shown| self.picture(shown)).collect::<Result<_, _>>()?;
        report.figures(&pictures, 3);
        report.figure(&self.way());
        self.conduct(&mut report);
        self.coverage(&mut report);
        Ok(report)
    }

    /// Regret and errors over time, and the three worst frames: small enough for a page of text.
    ///
    /// # Errors
    /// Where a picture cannot be made.
    pub fn overview(&self) -> Result<Figure, CompareError> {
        let [_, _, regret, strips @ ..] = &self.over_time()[..] else { return Ok(self.way()) };
        let three =
            self.worst.iter().take(3).map(|shown| self.picture(shown)).collect::<Result<Vec<_>, _>>()?;
        let maps = Figure::sheet("The worst frames", &three, 3);
        let all: Vec<_> = [regret.clone()].into_iter().chain(strips.iter().cloned()).chain([maps]).collect();
        Ok(Figure::stack(&format!("{} against {}", self.names[0], self.names[1]), &all))
    }

    fn picture(&self, shown: &Shown) -> Result<Figure, ReportError> {
        shown.figure(&self.robot.footprint.polygon_m, [&self.names[0], &self.names[1]])
    }

    fn warnings(&self, report: &mut Report) {
        for read in &self.recordings {
            if let Some(damage) = &read.origin.damage {
                report.warning(&format!(
                    "{} is cut: {damage}. Everything before is compared.",
                    read.origin.file
                ));
            }
            if read.origin.lost > 0 {
                report.warning(&format!(
                    "{} lacks {} messages that the recorder lost.",
                    read.origin.file, read.origin.lost
                ));
            }
        }
        if self.seen_differently > 0 {
            report.warning(&format!(
                "{} frames are left out: both recordings hold them, but map, goal or velocity differ.",
                self.seen_differently
            ));
        }
    }

    fn tiles(&self) -> Vec<(String, String)> {
        let (figures, [first, second]) = (&self.figures, &self.names);
        let errors = figures.windows.first().map_or_else(Errors::default, |window| window.errors);
        let sums = |value: &dyn Fn(&Conduct) -> f64| -> f64 {
            self.recordings.iter().map(|read| value(&read.conduct)).sum()
        };
        let tiles = [
            (format!("{:.1} %", 100.0 * figures.agreement.share), "of frames agree (0.09 m/s and 0.3 rad/s)"),
            (format!("{:.3}", errors.v_mean), "m/s, mean error of v within 0.1 s"),
            (format!("{:.3}", errors.w_mean), "rad/s, mean error of w within 0.1 s"),
            (format!("{:.3}", figures.regret.gaps[0]), &format!("mean optimality gap, {first}")),
            (format!("{:.3}", figures.regret.gaps[1]), &format!("mean optimality gap, {second}")),
            (format!("{:.0}", sums(&|conduct| conduct.takeover_count() as f64)), "changes of who drives"),
            (format!("{:.2} s", sums(&Conduct::changed_s)), "changed or stopped by the arbiter"),
        ];
        tiles.map(|(value, name)| (value, name.to_owned())).to_vec()
    }

    fn line(&self, number: impl Fn(&Point) -> f64) -> Vec<(f64, f64)> {
        self.points.iter().map(|point| (point.time_s, number(point))).collect()
    }

    /// Error of v, error of w, regret, and a strip per recording.
    fn over_time(&self) -> Vec<Figure> {
        let [first, second] = &self.names;
        let difference = format!("{first} minus {second}");
        let plot = |title: &str, unit: &str, ink, points, marks: &[f64]| {
            let mut plot =
                LinePlot::new(title, self.time(), Axis::new(&difference, unit)).series(title, ink, points);
            plot.gap = GAP_S;
            plot.height = 230.0;
            plot.marks = marks.iter().map(|mark| (*mark, String::new())).collect();
            plot.figure()
        };
        let v = f64::from(LARGE_V_M_S);
        let w = f64::from(LARGE_W_RAD_S);
        let mut figures = vec![
            plot("Error of the speed v", "m/s", Ink::Blue, self.line(|point| point.v_m_s.into()), &[-v, v])
                .caption("Dashed: within these the two agree."),
            plot(
                "Error of the turn rate w",
                "rad/s",
                Ink::Vermilion,
                self.line(|point| point.w_rad_s.into()),
                &[-w, w],
            ),
        ];
        let gap = |side: usize| self.line(move |point| point.gap(side).into());
        let mut regret = LinePlot::new(
            "Optimality gap: cost J above the least that is known",
            self.time(),
            Axis::new("gap", "1"),
        )
        .series(second, INKS[1], gap(1))
        .series(first, INKS[0], gap(0));
        (regret.gap, regret.height) = (GAP_S, 250.0);
        figures.push(regret.figure());
        figures.extend(self.recordings.iter().zip(["A", "B"]).map(|(read, letter)| {
            let whose = if self.recordings.len() > 1 { format!(" in {letter}") } else { String::new() };
            strip(&format!("Who drove{whose}"), self.time(), &read.conduct.by_winner, &read.conduct.by_reason)
        }));
        figures
    }

    /// The same time axis for everything.
    fn time(&self) -> Axis {
        let ends =
            self.recordings.iter().filter_map(|read| read.conduct.by_winner.last()).map(|last| last.to_s);
        let end = self.points.iter().map(|point| point.time_s).chain(ends).fold(1.0, f64::max);
        Axis::new("time", "s").over(0.0, end)
    }

    fn error_table(&self) -> Table {
        let columns = [
            ("window", "s"),
            ("|v| mean", "m/s"),
            ("|v| std", "m/s"),
            ("|w| mean", "rad/s"),
            ("|w| std", "rad/s"),
            ("norm of (v, w), mean", "1"),
        ];
        let mut table = Table::new("Absolute error, all frames compared", &columns);
        for window in &self.figures.windows {
            let e = &window.errors;
            let numbers =
                [e.v_mean, e.v_std, e.w_mean, e.w_std, e.l2_mean].map(|number| format!("{number:.4}"));
            table.row([format!("{:.1}", window.window_s)].into_iter().chain(numbers));
        }
        table
    }

    fn boxes(&self) -> [Figure; 2] {
        let boxes = |title: &str, unit: &str, limit: f32, numbers: [&dyn Fn(&Point) -> f32; 2], ink| {
            let spread = |number: &dyn Fn(&Point) -> f32| {
                Spread::of(self.points.iter().map(|point| number(point).abs().into()))
            };
            let named = ["within 0.1 s", "within 0.3 s"].into_iter().zip(numbers.map(spread));
            Boxes {
                title: title.into(),
                y: Axis::new("absolute error", unit),
                boxes: named.filter_map(|(name, spread)| Some((name.into(), ink, spread?))).collect(),
                marks: vec![(limit.into(), format!("{limit} {unit}"))],
            }
            .figure()
        };
        let v: [&dyn Fn(&Point) -> f32; 2] = [&|point| point.near[0], &|point| point.v_m_s];
        let w: [&dyn Fn(&Point) -> f32; 2] = [&|point| point.near[1], &|point| point.w_rad_s];
        [
            boxes("Error of the speed v", "m/s", LARGE_V_M_S, v, Ink::Blue),
            boxes("Error of the turn rate w", "rad/s", LARGE_W_RAD_S, w, Ink::Vermilion),
        ]
    }

    fn regret_histogram(&self) -> Figure {
        let values: Vec<f64> = self.points.iter().map(|point| f64::from(point.regret())).collect();
        let (least, most) = (values.iter().copied().fold(0.0, f64::min), self.figures.regret.p99.max(0.1));
        let axis = Axis::new("regret dJ", "1").over(least.max(-most), 1.05 * most);
        Bars::histogram("What the difference costs", &values, &axis, 48, Ink::Purple).caption(format!(
            "Mean {:.3}; on {:.0} % of the frames the {} is the better one. The outer bars hold everything beyond.",
            self.figures.regret.mean,
            100.0 * self.figures.regret.first_better,
            self.names[0]
        ))
    }

    fn doubt_scatter(&self) -> Figure {
        let cloud = |name: &str, ink, number: &dyn Fn(&Point) -> (f32, f32), reach: f32| {
            let points = self.points.iter().map(number).filter(|(doubt, _)| doubt.is_finite());
            let points =
                points.map(|(doubt, error)| ((doubt / reach).into(), (error.abs() / reach).into())).collect();
            Cloud { name: name.into(), ink, points, joined: false }
        };
        let clouds = vec![
            cloud("w", Ink::Vermilion, &|point| (point.doubt[1], point.w_rad_s), 0.9),
            cloud("v", Ink::Blue, &|point| (point.doubt[0], point.v_m_s), 0.3),
        ];
        let most =
            clouds.iter().flat_map(|cloud| &cloud.points).fold(0.05, |most: f64, point| most.max(point.0));
        let end = most.min(1.0);
        let caught = self.figures.doubt_catches.map_or_else(
            || "No frame disagrees, or there is no measure of doubt.".to_owned(),
            |part| format!("Does it know when it is wrong? The tenth of most doubt holds {:.0} % of the disagreements.", 100.0 * part),
        );
        Scatter {
            title: "Doubt against error".into(),
            x: Axis::new("doubt, part of the window", "1").over(0.0, end),
            y: Axis::new("error, part of the window", "1"),
            clouds,
            guide: Some((vec![(0.0, 0.0), (end, end)], "as doubted".into())),
            equal: false,
        }
        .figure()
        .caption(caught)
    }

    /// Where the robot went, and where the worst frames lie.
    fn way(&self) -> Figure {
        let way = self.points.iter().map(|point| (f64::from(point.x_m), f64::from(point.y_m))).collect();
        let times: Vec<f64> = self.worst.iter().map(|shown| shown.time_s).collect();
        let at = |time_s: &f64| {
            let place = self.points.partition_point(|point| point.time_s < *time_s);
            self.points.get(place).map(|point| (f64::from(point.x_m), f64::from(point.y_m)))
        };
        let marks = times.iter().filter_map(at).collect();
        let clouds = vec![
            Cloud { name: "way".into(), ink: Ink::Grey, points: way, joined: true },
            Cloud { name: "worst frames".into(), ink: Ink::Purple, points: marks, joined: false },
        ];
        let (x, y) = (Axis::new("x in odom", "m"), Axis::new("y in odom", "m"));
        let title = "Where it happened".to_owned();
        Scatter { title, x, y, clouds, guide: None, equal: true }.figure()
    }

    fn conduct(&self, report: &mut Report) {
        report.heading("What the arbiter made of it");
        for read in &self.recordings {
            let conduct = &read.conduct;
            if self.recordings.len() > 1 {
                report.paragraph(&read.origin.file);
            }
            if let Some(outcome) = &conduct.outcome {
                report.paragraph(&format!(
                    "In the simulation: {:.1} m driven, {} goals reached, {} contacts, nearest {:.2} m.",
                    outcome.distance_m, outcome.arrivals, outcome.contacts, outcome.min_clearance_m
                ));
            }
            report.table(&episode_table("Who drove", "winner", &conduct.winners));
            report.table(&episode_table("Why the command was what it was", "reason", &conduct.reasons));
            if !conduct.takeovers.is_empty() {
                let columns = [("from", ""), ("to", ""), ("reason", ""), ("count", ""), ("first", "s")];
                let mut table = Table::new("Takeovers", &columns);
                for t in &conduct.takeovers {
                    let (count, first) = (t.count.to_string(), format!("{:.2}", t.first_s));
                    table.row([t.from, t.to, t.reason, &count, &first]);
                }
                report.table(&table);
            }
        }
    }

    fn coverage(&self, report: &mut Report) {
        report.heading("What was compared");
        let mut table = Table::new(
            "Frames",
            &[("recording", ""), ("maps", ""), ("policy", ""), ("expert", ""), ("both", ""), ("skipped", "")],
        );
        for read in &self.recordings {
            let c = &read.coverage;
            let counts = [c.maps, c.policy, c.expert, c.both, c.skipped].map(|count| count.to_string());
            table.row([read.origin.file.clone()].into_iter().chain(counts));
        }
        report.table(&table);
        report.paragraph(&format!("Compared: {} frames on which both had work to do.", self.figures.frames));
        let mut table = Table::new("Proposals", &[("proposer", ""), ("what it said", ""), ("frames", "")]);
        for read in &self.recordings {
            let c = &read.coverage;
            for (name, statuses) in [("policy", &c.policy_statuses), ("expert", &c.expert_statuses)] {
                for (status, count) in statuses {
                    table.row([name, status, &count.to_string()]);
                }
            }
        }
        report.table(&table);
        let columns = [
            ("proposer", ""),
            ("step p50", "ms"),
            ("step p99", "ms"),
            ("age p50", "ms"),
            ("age p99", "ms"),
            ("age max", "ms"),
        ];
        let mut table =
            Table::new("Time of a step, and age of the proposal when its frame was answered", &columns);
        for read in &self.recordings {
            for (name, ages) in ["policy", "expert"].into_iter().zip(read.ages) {
                let step = |key: &str| {
                    read.latency_ms[name][key].as_f64().map_or("-".into(), |ms| format!("{ms:.3}"))
                };
                let age = |number: &dyn Fn(Ages) -> f64| {
                    ages.map_or("-".into(), |ages| format!("{:.2}", number(ages)))
                };
                let ages = [age(&|a| a.p50_ms), age(&|a| a.p99_ms), age(&|a| a.max_ms)];
                table.row([name.to_owned(), step("p50"), step("p99")].into_iter().chain(ages));
            }
        }
        report.table(&table);
    }
}

fn episode_table(caption: &str, what: &str, episodes: &BTreeMap<&'static str, Episodes>) -> Table {
    let columns = [(what, ""), ("times", ""), ("total", "s"), ("longest", "s"), ("first", "s")];
    let mut table = Table::new(caption, &columns);
    let mut sorted: Vec<_> = episodes.iter().collect();
    sorted.sort_by(|a, b| b.1.total_s.total_cmp(&a.1.total_s));
    for (name, e) in sorted {
        let first: Vec<_> = e.first_s.iter().map(|time_s| format!("{time_s:.2}")).collect();
        let numbers = [
            e.count.to_string(),
            format!("{:.2}", e.total_s),
            format!("{:.2}", e.longest_s),
            first.join(", "),
        ];
        table.row([(*name).to_owned()].into_iter().chain(numbers));
    }
    table
}

fn strip(title: &str, time: Axis, winners: &[Stretch], reasons: &[Stretch]) -> Figure {
    let winner = |code| match Winner::from_code(code) {
        Some(Winner::Policy) => Ink::Blue,
        Some(Winner::Expert) => Ink::Vermilion,
        Some(Winner::Teleop) => Ink::Purple,
        Some(Winner::Recovery) => Ink::Orange,
        Some(Winner::Stop) | None => Ink::Text,
    };
    let spans = |stretches: &[Stretch], ink: &dyn Fn(u32) -> Option<Ink>| -> Vec<Span> {
        let span = |s: &Stretch| Some(Span { from: s.from_s, to: s.to_s, ink: ink(s.code)? });
        stretches.iter().filter_map(span).collect()
    };
    let changed = |code| match Reason::from_code(code) {
        Some(Reason::Clear) => None,
        Some(Reason::Slowed | Reason::Yielding | Reason::Straight | Reason::Rotating | Reason::Reversing) => {
            Some(Ink::Orange)
        }
        Some(Reason::OtherProposal) => Some(Ink::Sky),
        _ => Some(Ink::Text),
    };
    let rows = vec![
        ("winner".to_owned(), spans(winners, &|code| Some(winner(code)))),
        ("changed".to_owned(), spans(reasons, &changed)),
    ];
    let meanings = [
        ("policy", Ink::Blue),
        ("expert", Ink::Vermilion),
        ("other proposal", Ink::Sky),
        ("slowed, or way out", Ink::Orange),
        ("teleop", Ink::Purple),
        ("stop", Ink::Text),
    ];
    let shown: Vec<_> = rows.iter().flat_map(|row| &row.1).map(|span| span.ink).collect();
    let meanings = meanings.into_iter().filter(|(_, ink)| shown.contains(ink));
    Strip {
        title: title.into(),
        x: time,
        rows,
        meanings: meanings.map(|(name, ink)| (name.into(), ink)).collect(),
    }
    .figure()
}

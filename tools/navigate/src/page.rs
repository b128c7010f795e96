//! Everything measured, as one report and as JSON.

use crate::beside::Beside;
use crate::corridor::{Contrast, Corridors, LIMIT_S, PROGRESS_M, STUCK_S, TRAININGS};
use crate::drawing;
use crate::error::NavigateError;
use crate::pilot::Ending;
use crate::room::{GRADES, SIZE_M, WAY_M};
use crate::sudden::Sudden;
use crate::suite::{Failure, Group, Suite};
use serde::Serialize;
use sidestep_msgs::Robot;
use sidestep_report::{Axis, Bars, Ink, Report, Table};

/// Failures that are drawn, of each suite.
const DRAWN: usize = 6;
/// Corridors that are drawn: those in which most interventions were needed.
const CORRIDORS_DRAWN: usize = 3;

/// Everything that was driven; what was not is empty.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Navigation {
    /// Suites of courses.
    pub suites: Vec<Suite>,
    /// The worlds of Fig. 7.
    pub beside: Vec<Beside>,
    /// The scenes of Fig. 8.
    pub sudden: Vec<Sudden>,
    /// The corridors of Fig. 9.
    pub corridors: Option<Corridors>,
}

impl Navigation {
    /// The report, with the numbers within; [`Report::json`] has them alone.
    ///
    /// # Errors
    /// [`NavigateError`] where a picture or the numbers cannot be made.
    pub fn report(&self, robot: &Robot, subtitle: &str) -> Result<Report, NavigateError> {
        let mut report = Report::new("Navigation in closed loop", subtitle, serde_json::to_value(self)?);
        for suite in &self.suites {
            describe_suite(suite, &mut report);
        }
        if !self.beside.is_empty() {
            describe_beside(&self.beside, &mut report);
        }
        if !self.sudden.is_empty() {
            describe_sudden(&self.sudden, robot, &mut report)?;
        }
        if let Some(corridors) = &self.corridors {
            describe_corridors(corridors, &mut report);
        }
        Ok(report)
    }
}

fn describe_suite(suite: &Suite, report: &mut Report) {
    let (name, sight) = (&suite.name, suite.sight);
    report.heading(&format!("Closed loop: {name}, sight {sight}"));
    let how = if sight == "grid" {
        "Both maps are drawn from the world at the true pose: no camera, no mapper; noise of odometry and the dynamics of the base stay."
    } else {
        "The whole chain: rendered depth with noise, mapper, goal, proposers, arbiter, dynamics of the base."
    };
    report.paragraph(&format!(
        "{how} A course counts as reached at its goal within {:.0} s without contact; shares with the 95 % interval of Clopper and \
         Pearson. The reference path keeps {WAY_M} m from everything it knows of. The straight line from start to goal is blocked in {} of \
         the courses, the reference path itself in {}. J is eq. (6) for the best plan that begins with the command, every 0.5 s.",
        suite.limit_s,
        suite.straight_blocked.text(),
        suite.path_blocked.text()
    ));
    report.table(&main_table(suite));
    report.table(&way_table(suite));
    report.table(&grade_table(suite));
    let failures: Vec<(&Group, &Failure)> = suite
        .groups
        .iter()
        .flat_map(|group| group.failures.iter().map(move |failure| (group, failure)))
        .collect();
    if failures.is_empty() {
        report.paragraph("No course failed under any condition.");
        return;
    }
    report.table(&failure_table(&failures));
    // Contacts first: they are what matters.
    let mut drawn = failures;
    drawn.sort_by_key(|(_, failure)| failure.ending != Ending::Contact);
    let figures: Vec<_> = drawn
        .iter()
        .take(DRAWN)
        .map(|(group, failure)| {
            let ending = ending(failure.ending);
            drawing::failed(failure, SIZE_M).caption(format!("{}: {ending}", conditions(group)))
        })
        .collect();
    report.figures(&figures, 2);
}

fn conditions(group: &Group) -> String {
    format!("{}, arbiter {}", group.lead.label(), on(group.arbitrated))
}

fn on(arbitrated: bool) -> &'static str {
    if arbitrated { "on" } else { "off" }
}

fn ending(ending: Ending) -> &'static str {
    match ending {
        Ending::Reached => "reached",
        Ending::Contact => "contact",
        Ending::Late => "not in time",
    }
}

fn main_table(suite: &Suite) -> Table {
    let columns = [
        ("lead", ""),
        ("arbiter", ""),
        ("reached", "95 %"),
        ("contact", "95 %"),
        ("J, mean", "1"),
        ("J, median course", "1"),
    ];
    let mut table = Table::new(&format!("Reached and contacts, model {}", suite.model), &columns);
    for group in &suite.groups {
        let cells = [group.lead.label().to_owned(), on(group.arbitrated).to_owned()];
        let costs = [group.cost, group.cost_median].map(|cost| format!("{cost:.3}"));
        table.row(cells.into_iter().chain([group.reached.text(), group.contact.text()]).chain(costs));
    }
    table
}

fn way_table(suite: &Suite) -> Table {
    let columns = [
        ("lead", ""),
        ("arbiter", ""),
        ("time", "s"),
        ("way", "m"),
        ("speed", "m/s"),
        ("where both ways reached", "m/s"),
        ("standing", "s"),
        ("stops", "1"),
        ("clearance, mean", "m"),
        ("least", "m"),
    ];
    let mut table = Table::new(
        "Time, way and speed: means of the courses reached; standing, stops and smallest gap: of all courses",
        &columns,
    );
    for group in &suite.groups {
        let cells = [group.lead.label().to_owned(), on(group.arbitrated).to_owned()];
        let numbers = [
            format!("{:.2}", group.time_s),
            format!("{:.2}", group.distance_m),
            format!("{:.3}", group.speed_m_s),
            format!("{:.3}", group.shared_speed_m_s),
            format!("{:.2}", group.standing_s),
            format!("{:.2}", group.stops),
            format!("{:.3}", group.clearance_m),
            format!("{:.3}", group.min_clearance_m),
        ];
        table.row(cells.into_iter().chain(numbers));
    }
    table
}

fn grade_table(suite: &Suite) -> Table {
    let columns =
        [("lead", ""), ("arbiter", ""), ("difficulty", ""), ("reached", "95 %"), ("contact", "95 %")];
    let stated = GRADES.iter().map(|grade| {
        format!(
            "{}: {} obstacles at least {} m apart, {} walls with a door of {} to {} m, {} not known to the path",
            grade.name,
            grade.obstacles,
            grade.passage_m,
            grade.walls,
            grade.door_m[0],
            grade.door_m[1],
            grade.unmapped
        )
    });
    let known = |name: &str| GRADES.iter().any(|grade| grade.name == name);
    let all_known = suite.groups.iter().flat_map(|group| &group.grades).all(|share| known(&share.grade));
    let stated: Vec<String> = if all_known { stated.collect() } else { Vec::new() };
    let mut table = Table::new(&format!("By difficulty. {}", stated.join("; ")), &columns);
    for group in &suite.groups {
        for share in &group.grades {
            let cells = [group.lead.label().to_owned(), on(group.arbitrated).to_owned(), share.grade.clone()];
            table.row(cells.into_iter().chain([share.reached.text(), share.contact.text()]));
        }
    }
    table
}

fn failure_table(failures: &[(&Group, &Failure)]) -> Table {
    let columns = [
        ("course", ""),
        ("difficulty", ""),
        ("seed", ""),
        ("who", ""),
        ("end", ""),
        ("time", "s"),
        ("where", "m"),
    ];
    let mut table = Table::new("Every course that was not reached", &columns);
    for (group, failure) in failures {
        table.row([
            failure.course.clone(),
            failure.grade.clone(),
            failure.seed.to_string(),
            conditions(group),
            ending(failure.ending).into(),
            format!("{:.1}", failure.time_s),
            format!("{:.2}, {:.2}", failure.at_m[0], failure.at_m[1]),
        ]);
    }
    table
}

fn describe_beside(worlds: &[Beside], report: &mut Report) {
    report.heading("Policy beside demonstrator (the paper's Fig. 7)");
    report.paragraph(
        "A reference path close to and across obstacles, driven by the policy, by the demonstrator of 734 candidates and by the solved \
         plans, without an arbiter. The distance between two paths is that of the points of either to the other.",
    );
    let columns = [("world", ""), ("one", ""), ("other", ""), ("mean", "m"), ("largest", "m")];
    let mut distances = Table::new("Distance between paths", &columns);
    let columns = [("world", ""), ("lead", ""), ("end", ""), ("time", "s"), ("smallest gap", "m")];
    let mut drives = Table::new("Drives", &columns);
    for world in worlds {
        report.figure(&drawing::side_by_side(world));
        for apart in &world.distances {
            let names = [world.name.clone(), apart.one.label().into(), apart.other.label().into()];
            let numbers = [apart.mean_m, apart.max_m].map(|metres| format!("{metres:.3}"));
            distances.row(names.into_iter().chain(numbers));
        }
        for drive in &world.drives {
            drives.row([
                world.name.clone(),
                drive.lead.label().into(),
                ending(drive.ending).into(),
                format!("{:.2}", drive.time_s),
                format!("{:.3}", drive.min_clearance_m),
            ]);
        }
    }
    report.table(&distances);
    report.table(&drives);
}

fn describe_sudden(scenes: &[Sudden], robot: &Robot, report: &mut Report) -> Result<(), NavigateError> {
    report.heading("A sudden obstacle (the paper's Fig. 8)");
    report.paragraph(
        "Something appears 1.8 m ahead of a policy at full speed; whole chain, no arbiter. Shown is the first frame in which the policy \
         proposes something else than in the same drive without the obstacle (by 0.09 m/s or 0.3 rad/s): the planning cost fed to it, \
         dark above the limit, and the depth image. Arrows are velocities held for a second; the dashed line is the path.",
    );
    let columns =
        [("scene", ""), ("reaction", "s"), ("gap then", "m"), ("goal reached", ""), ("smallest gap", "m")];
    let mut table = Table::new("Reactions", &columns);
    for scene in scenes {
        report.figures(&drawing::reaction(scene, robot)?, 2);
        table.row([
            scene.name.to_owned(),
            scene.reaction_s.map_or("none".into(), |after| format!("{after:.2}")),
            format!("{:.2}", scene.clearance_m),
            if scene.reached { "yes" } else { "no" }.into(),
            format!("{:.3}", scene.min_clearance_m),
        ]);
    }
    report.table(&table);
    Ok(())
}

fn describe_corridors(corridors: &Corridors, report: &mut Report) {
    report.heading("To and fro in a crowded corridor (the paper's Fig. 9)");
    report.paragraph(&format!(
        "A corridor of 18 m by 2.5 m, {} ways along its middle line, {} seeds, density {}, sight {}. Two models: \"normal\", trained on \
         demonstrations only, and \"mixed\", trained on artificial maps as well. Without an arbiter a contact, or {STUCK_S:.0} s without \
         {PROGRESS_M} m of way, is an intervention: the robot is pushed back onto the way; with it, anything but letting through or slowing is a takeover, and being stuck counts \
         too. A drive ends after {LIMIT_S:.0} s. These conditions are constants of the source.",
        corridors.legs,
        corridors.corridors.len(),
        corridors.density,
        corridors.sight
    ));
    let columns = [
        ("what", ""),
        ("normal", ""),
        ("mixed", ""),
        ("normal, per 100 m", ""),
        ("mixed, per 100 m", ""),
        ("normal needs more / same / fewer", "corridors"),
        ("p, exact", "1"),
    ];
    let mut table =
        Table::new("Paired by corridor; p: two-sided, signs of the differences flipped", &columns);
    let mut row = |what: &str, contrast: &Contrast| {
        let [more, same, fewer] = contrast.more_same_fewer;
        let totals = contrast.totals.map(|total| total.to_string());
        let rates = contrast.per_100_m.map(|rate| format!("{rate:.2}"));
        let tail = [format!("{more} / {same} / {fewer}"), format!("{:.4}", contrast.p)];
        table.row([what.to_owned()].into_iter().chain(totals).chain(rates).chain(tail));
    };
    row("interventions, arbiter off", &corridors.interventions);
    row("of these, contacts", &corridors.contacts);
    row("takeovers, arbiter on", &corridors.takeovers);
    report.table(&table);
    report.paragraph(&verdict(&corridors.interventions));
    report.figure(&bars(corridors));
    let mut order: Vec<usize> = (0..corridors.corridors.len()).collect();
    let total = |index: &usize| {
        corridors.corridors[*index].alone.iter().map(|drive| drive.interventions_m.len()).sum::<usize>()
    };
    order.sort_by_key(|index| std::cmp::Reverse(total(index)));
    for index in order.into_iter().take(CORRIDORS_DRAWN) {
        report.figure(&drawing::patrols(&corridors.corridors[index]));
    }
    report.table(&corridor_table(corridors));
}

fn verdict(contrast: &Contrast) -> String {
    let [normal, mixed] = contrast.totals;
    let found = if contrast.p < 0.05 && mixed < normal {
        "The paper's contrast is reproduced: the mixed model needs fewer interventions."
    } else if contrast.p < 0.05 {
        "The paper's contrast is reversed: the normal model needs fewer interventions."
    } else {
        "The paper's contrast is not reproduced: the difference may be chance."
    };
    format!("{found} {normal} against {mixed} interventions, p = {:.4}.", contrast.p)
}

fn bars(corridors: &Corridors) -> sidestep_report::Figure {
    let rows = [
        ("interventions, arbiter off", &corridors.interventions),
        ("contacts, arbiter off", &corridors.contacts),
        ("takeovers, arbiter on", &corridors.takeovers),
    ];
    let inks = [Ink::Vermilion, Ink::Blue];
    let bars = rows.iter().flat_map(|(what, contrast)| {
        let named = TRAININGS.iter().zip(inks).zip(contrast.per_100_m);
        named.map(move |((name, ink), rate)| (format!("{name}: {what}"), ink, rate))
    });
    Bars { title: "Needed per 100 m".into(), amount: Axis::new("per 100 m", ""), bars: bars.collect() }
        .figure()
}

fn corridor_table(corridors: &Corridors) -> Table {
    let columns = [
        ("seed", ""),
        ("arbiter", ""),
        ("model", ""),
        ("contacts", ""),
        ("stuck", ""),
        ("takeovers", ""),
        ("ways", ""),
        ("time", "s"),
        ("way", "m"),
        ("smallest gap", "m"),
    ];
    let mut table = Table::new("Every drive", &columns);
    for corridor in &corridors.corridors {
        for (arbiter, drives) in [("off", &corridor.alone), ("on", &corridor.guarded)] {
            for (name, drive) in TRAININGS.iter().zip(drives) {
                let counts =
                    [drive.contacts, drive.stuck, drive.takeovers, drive.legs].map(|n| n.to_string());
                let heads = [corridor.seed.to_string(), arbiter.to_owned(), (*name).to_owned()];
                let numbers = [
                    format!("{:.1}", drive.time_s),
                    format!("{:.1}", drive.distance_m),
                    format!("{:.3}", drive.min_clearance_m),
                ];
                table.row(heads.into_iter().chain(counts).chain(numbers));
            }
        }
    }
    table
}

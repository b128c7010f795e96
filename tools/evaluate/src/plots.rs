//! The figures of the paper, drawn from what was measured.

use crate::cases::Case;
use crate::doubt::Doubt;
use crate::evaluation::Evaluation;
use crate::gap::Gap;
use sidestep_expert::UNKNOWN_COST;
use sidestep_msgs::{LOCAL_CELLS, LOCAL_GRID, LOCAL_SIDE, Robot};
use sidestep_report::{Axis, Boxes, Cells, Figure, Ink, LinePlot, MapPicture, Overlay, ReportError, Shade};

/// Largest set of the curves that is drawn, as in the paper's range and a little beyond.
const SHOWN_CANDIDATES: usize = 2000;

/// A frame to draw: what the robot saw, and what was wished about it.
pub(crate) struct Frame<'a> {
    pub(crate) title: String,
    pub(crate) subtitle: String,
    /// `[1/255]`
    pub(crate) cost: &'a [u8; LOCAL_CELLS],
    pub(crate) partly_unknown: bool,
    pub(crate) goal_cell: u16,
    /// `[m]` the way of a plan.
    pub(crate) way_m: Vec<(f64, f64)>,
    /// Velocities with their names and inks; the first is drawn widest.
    pub(crate) wishes: Vec<(&'static str, Ink, [f32; 2])>,
}

impl Frame<'_> {
    pub(crate) fn figure(&self, robot: &Robot) -> Result<Figure, ReportError> {
        // Cost spread from obstacles can have the same byte: so far a made-up map is drawn a little too unknown.
        let shade = |cost: &u8| match *cost {
            UNKNOWN_COST if self.partly_unknown => Shade::Unknown,
            cost => Shade::Filled(f32::from(cost) / 255.0),
        };
        let goal = usize::from(self.goal_cell).min(LOCAL_CELLS - 1);
        let (x_m, y_m) = LOCAL_GRID.centre(goal / LOCAL_SIDE, goal % LOCAL_SIDE);
        let mut overlays =
            vec![Overlay::outline(&robot.footprint.polygon_m), Overlay::Goal(x_m.into(), y_m.into())];
        if let Some((_, ink, _)) = self.wishes.first() {
            overlays.push(Overlay::Line(self.way_m.clone(), *ink, true));
        }
        let widths_px = [8.0, 5.0, 3.0];
        let arrows = self.wishes.iter().zip(widths_px);
        overlays.extend(arrows.map(|((_, ink, twist), px)| Overlay::velocity(*twist, *ink, px)));
        MapPicture {
            title: self.title.clone(),
            subtitle: self.subtitle.clone(),
            cells: Cells::local(self.cost.iter().map(shade).collect()),
            overlays,
            notes: self.wishes.iter().map(|(name, ink, twist)| (*ink, named(name, *twist))).collect(),
        }
        .figure()
    }
}

/// A velocity with its name.
pub(crate) fn named(name: &str, [v, w]: [f32; 2]) -> String {
    format!("{name} {v:.2} m/s, {w:.2} rad/s")
}

/// Fig. 3.
pub(crate) fn case(case: &Case, robot: &Robot) -> Result<Figure, ReportError> {
    Frame {
        title: case.name.clone(),
        subtitle: format!("error {:.4}, {}", case.error, named("from", case.velocity)),
        cost: &case.cost,
        partly_unknown: case.partly_unknown,
        goal_cell: case.goal_cell,
        way_m: case.way_m.clone(),
        wishes: vec![
            ("solved", Ink::Vermilion, case.solved),
            ("734 candidates", Ink::Green, case.plain),
            ("policy", Ink::Blue, case.policy),
        ],
    }
    .figure(robot)
}

/// Fig. 5.
pub(crate) fn spreads(evaluation: &Evaluation) -> Figure {
    let boxes = evaluation.spreads.iter().map(|(name, spread)| {
        let ink = if name.starts_with("train") { Ink::Grey } else { Ink::Blue };
        (name.clone(), ink, spread.clone())
    });
    Boxes {
        title: "Fig. 5: absolute error, window 0.1 s, solved label".into(),
        y: Axis::new("error", "m/s, rad/s"),
        boxes: boxes.collect(),
        marks: Vec::new(),
    }
    .figure()
}

/// Fig. 6a.
pub(crate) fn times(evaluation: &Evaluation) -> Figure {
    let timing = &evaluation.timing;
    let points = timing.candidates.iter().map(|(count, us)| (*count as f64, *us));
    let shown: Vec<_> = points.filter(|point| point.0 <= SHOWN_CANDIDATES as f64).collect();
    LinePlot::new(
        "Fig. 6a: time of one answer",
        Axis::new("candidates", "").over(0.0, SHOWN_CANDIDATES as f64),
        Axis::new("time", "us"),
    )
    .series("optimisation with so many candidates", Ink::Vermilion, shown)
    .mark(timing.policy_us, "policy")
    .figure()
}

/// Fig. 6b, by baseline.
pub(crate) fn gaps(evaluation: &Evaluation, solved: bool) -> Figure {
    let value = |gap: &Gap| if solved { gap.solved[0] } else { gap.demonstrator[0] };
    let title = if solved { "Fig. 6b, optimum, window 0.1 s" } else { "Fig. 6b, demonstrator, window 0.1 s" };
    let mut plot = LinePlot::new(
        title,
        Axis::new("candidates", "").over(0.0, SHOWN_CANDIDATES as f64),
        Axis::new("optimality gap", "norm of m/s, rad/s"),
    );
    for (curve, ink) in evaluation.curves.iter().zip([Ink::Vermilion, Ink::Green, Ink::Grey]) {
        let points = curve.points.iter().filter(|point| point.0 <= SHOWN_CANDIDATES);
        let points = points.map(|(count, gap)| (*count as f64, value(gap))).collect();
        plot = plot.series(&curve.name, ink, points);
    }
    plot.mark(value(&evaluation.gap), "policy").figure()
}

/// Doubt against error.
pub(crate) fn reliability(name: &str, doubt: &Doubt) -> Vec<Figure> {
    let plot = |axis: &crate::doubt::Axis, title: &str, unit: &str| {
        let points: Vec<_> = axis.bins.iter().map(|bin| (bin.doubt, bin.error)).collect();
        let most = points.iter().map(|point| point.0.max(point.1)).fold(0.0, f64::max);
        LinePlot::new(
            &format!("{title}, {name}"),
            Axis::new("mean doubt of a tenth of the frames", unit),
            Axis::new("mean error", unit),
        )
        .series("as it should be", Ink::Grey, vec![(0.0, 0.0), (most, most)])
        .series("measured", Ink::Blue, points)
        .figure()
    };
    vec![plot(&doubt.v, "Doubt about v", "m/s"), plot(&doubt.w, "Doubt about w", "rad/s")]
}

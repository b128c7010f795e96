//! One frame drawn: what both saw, what they wished, what the arbiter commanded.

use crate::conduct::reason_label;
use crate::frames::Shown;
use sidestep_msgs::{AGE_NEVER, LOCAL_GRID, LOCAL_SIDE, Pose2, Twist};
use sidestep_report::{Cells, Figure, Ink, MapPicture, Overlay, ReportError, Shade};

/// Inks of the first and the second.
pub(crate) const INKS: [Ink; 2] = [Ink::Blue, Ink::Vermilion];
/// Ink of the arbiter.
const ARBITER: Ink = Ink::Green;
/// `[s]` a velocity drawn as an arrow is held this long.
const ARROW_S: f64 = 1.0;
/// `[px]` widths of the two arrows; the arbiter's is the thin one on top, so that all three are seen.
const WIDTHS_PX: [f64; 2] = [8.0, 5.0];
/// `[1]` eq. (6c): planning cost above this is not safe.
const LIMIT: f32 = 0.4;

/// The way of a velocity held for a second.
fn held(v_m_s: f32, w_rad_s: f32) -> Vec<(f64, f64)> {
    const STEPS: u32 = 20;
    let twist = Twist::new(v_m_s, w_rad_s);
    let pose = |step| Pose2::ORIGIN.advance(&twist, ARROW_S * f64::from(step) / f64::from(STEPS));
    (0..=STEPS).map(|step| (pose(step).x_m, pose(step).y_m)).collect()
}

pub(crate) fn picture(
    shown: &Shown,
    footprint_m: &[[f32; 2]],
    names: [&str; 2],
) -> Result<Figure, ReportError> {
    let map = &shown.map;
    let shade = |(cost, age): (&u8, &u8)| {
        if *age == AGE_NEVER { Shade::Unknown } else { Shade::Filled(f32::from(*cost) / 255.0) }
    };
    let cells = Cells {
        side: LOCAL_SIDE,
        cell_m: LOCAL_GRID.cell_m.into(),
        rear_m: LOCAL_GRID.rear_m.into(),
        right_m: LOCAL_GRID.right_m.into(),
        limit: LIMIT,
        shades: map.planning_cost.iter().zip(&map.age).map(shade).collect(),
    };
    let mut overlays = vec![Overlay::Footprint(
        footprint_m.iter().map(|corner| (f64::from(corner[0]), f64::from(corner[1]))).collect(),
    )];
    overlays.push(Overlay::Goal(shown.goal_cell_m[0].into(), shown.goal_cell_m[1].into()));
    for (way, ink) in shown.ways.iter().zip(INKS) {
        overlays.push(Overlay::Line(
            [(0.0, 0.0)].into_iter().chain(way.iter().copied()).collect(),
            ink,
            true,
        ));
    }
    let mut notes = Vec::new();
    for (side, width_px) in WIDTHS_PX.into_iter().enumerate() {
        let (v, w) = (shown.v_m_s[side], shown.w_rad_s[side]);
        overlays.push(Overlay::Arrow(held(v, w), INKS[side], width_px));
        notes.push((
            INKS[side],
            format!("{}: {v:.2} m/s, {w:+.2} rad/s, J {:.2}", names[side], shown.costs[side]),
        ));
    }
    if let Some(command) = &shown.command {
        let Twist { v_m_s, w_rad_s } = command.twist;
        overlays.push(Overlay::Arrow(held(v_m_s, w_rad_s), ARBITER, 2.2));
        notes.push((ARBITER, format!("arbiter: {v_m_s:.2} m/s, {w_rad_s:+.2} rad/s")));
    }
    let title = format!("{:.2} s, regret {:.2}", shown.time_s, shown.regret);
    let reason = shown.command.as_ref().map_or("", |command| reason_label(command.reason));
    let subtitle = format!("frame {}; {reason}", shown.frame);
    MapPicture { title, subtitle, cells, overlays, notes }.figure()
}

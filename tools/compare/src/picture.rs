//! One frame drawn: what both saw, what they wished, what the arbiter commanded.

use crate::conduct::reason_label;
use crate::frames::Shown;
use sidestep_msgs::{AGE_NEVER, Twist};
use sidestep_report::{Cells, Figure, Ink, MapPicture, Overlay, ReportError, Shade};

/// Inks of the first and the second.
pub(crate) const INKS: [Ink; 2] = [Ink::Blue, Ink::Vermilion];
/// Ink of the arbiter.
const ARBITER: Ink = Ink::Green;
/// `[px]` widths of the two arrows; the arbiter's is the thin one on top, so that all three are seen.
const WIDTHS_PX: [f64; 2] = [8.0, 5.0];
pub(crate) fn picture(
    shown: &Shown,
    footprint_m: &[[f32; 2]],
    names: [&str; 2],
) -> Result<Figure, ReportError> {
    let map = &shown.map;
    let shade = |(cost, age): (&u8, &u8)| {
        if *age == AGE_NEVER { Shade::Unknown } else { Shade::Filled(f32::from(*cost) / 255.0) }
    };
    let cells = Cells::local(map.planning_cost.iter().zip(&map.age).map(shade).collect());
    let mut overlays = vec![Overlay::outline(footprint_m)];
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
        overlays.push(Overlay::velocity([v, w], INKS[side], width_px));
        notes.push((
            INKS[side],
            format!("{}: {v:.2} m/s, {w:+.2} rad/s, J {:.2}", names[side], shown.costs[side]),
        ));
    }
    if let Some(command) = &shown.command {
        let Twist { v_m_s, w_rad_s } = command.twist;
        overlays.push(Overlay::velocity([v_m_s, w_rad_s], ARBITER, 2.2));
        notes.push((ARBITER, format!("arbiter: {v_m_s:.2} m/s, {w_rad_s:+.2} rad/s")));
    }
    let title = format!("{:.2} s, regret {:.2}", shown.time_s, shown.regret);
    let reason = shown.command.as_ref().map_or("", |command| reason_label(command.reason));
    let subtitle = format!("frame {}; {reason}", shown.frame);
    MapPicture { title, subtitle, cells, overlays, notes }.figure()
}

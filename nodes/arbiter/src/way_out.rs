//! A way out for a robot that stands: on towards the goal over free cells, or, where none leads on, to where the camera sees
//! the first cell on the way there that nobody saw.
//!
//! Nothing is promised: every motion along it passes the filter as any other.

use crate::clearance::{Heading, Outline, Rows};
use crate::maneuver::{Kind, LEGS, Leg, Maneuver};
use crate::stencil::{
    Beginning, CELL_M, HALF_MAP, HEADINGS, Layer, Place, Runs, SIDE, Stencils, direction, index, middle_m,
    window,
};
use crate::wave::{Asked, Blinders, Eye, Step, Wave};
use bytemuck::Zeroable;
use sidestep_msgs::{Pose2, Robot, SAFETY_SIDE};
use wide::f32x4;

/// Steps of the longest way: 0.14 to 0.16 m, or a turn of 18 to 27 degrees; and of both looks for one together, which bounds the
/// time of a step of the arbiter.
const LONGEST: usize = 28;
const BOTH: usize = 40;
/// Turns of a leg: less than half a circle, so that its end says to which side.
const TURNS: usize = 6;
/// `[m]` widening of the footprint beyond its margin: a way with room beside it may take so many steps more.
const ROOMY_M: f32 = 0.025;
const DETOUR: usize = 8;
/// Numbers of the two widths.
const ROOMY: usize = 0;
const NARROW: usize = 1;
/// `[m]` how far on towards the goal is enough, and how far beside the line to it; cosine of the angle to it.
const ON_M: f32 = 0.6;
const ASIDE_M: f32 = 0.45;
const FACING: f32 = 0.8;
/// `[m]` where an unseen cell on the way to the goal is looked for, from how far ahead to how far.
const UNSEEN_M: [f32; 2] = [0.1, 1.5];
/// `[m]` farthest that it is looked at from, how much farther than the camera needs, and directions to look from.
const VIEW_M: f32 = 2.4;
const BEYOND_M: f32 = 0.1;
const VIEWS: usize = 64;
/// `[m]` how much farther than it can measure a camera stays off what fills its view, and the part of its view that counts.
const NEAR_M: f32 = 0.05;
const VIEW: f32 = 0.9;

/// What a way out is looked for in.
pub(crate) struct Scene<'a> {
    /// Frame of the safety map in `odom`.
    pub(crate) frame: &'a Pose2,
    /// Where the robot is, in that frame.
    pub(crate) at: &'a Heading,
    pub(crate) blocked: &'a Rows,
    /// Cells that are blocked because nobody saw them.
    pub(crate) unknown: &'a Rows,
    /// `[m]` the goal in that frame, and the way left to the last one.
    pub(crate) goal_m: [f32; 2],
    pub(crate) left_m: f32,
}

/// Looks for ways out.
#[derive(Debug, Clone)]
pub(crate) struct Planner {
    /// With room beside the way, and without: [`ROOMY`] and [`NARROW`].
    stencils: [Stencils; 2],
    /// `[m]` from the axle to the nearest floor that the camera sees; 0 for a scanner.
    blind_m: f32,
    /// None for a scanner.
    blinders: Option<Blinders>,
    half_width_m: f32,
    runs: Runs,
    wave: Box<Wave>,
    /// Places that lead on, and places that see.
    on: Box<Asked>,
    view: Box<Asked>,
}

impl Planner {
    pub(crate) fn new(robot: &Robot, outline: &Outline, margin_m: f32) -> Self {
        Self {
            stencils: [margin_m + ROOMY_M, margin_m].map(|margin_m| Stencils::new(outline, margin_m)),
            blind_m: robot.blind_m(),
            blinders: robot.camera.map(|camera| {
                Blinders::new(&Eye {
                    forward_m: camera.forward_m,
                    near_m: camera.near_m + NEAR_M,
                    half_view_rad: VIEW * robot.half_view_rad(),
                })
            }),
            half_width_m: robot.half_width_m(),
            runs: Runs::new(),
            wave: Wave::new(),
            on: Asked::new(),
            view: Asked::new(),
        }
    }

    /// The way on of the fewest steps, else that to a view, of at most [`LEGS`] legs; with room beside it, if it is not much longer.
    pub(crate) fn find(&mut self, scene: &Scene<'_>) -> Option<Maneuver> {
        let blocked = window(scene.blocked);
        let stands: Rows = std::array::from_fn(|row| scene.blocked[row] & !scene.unknown[row]);
        self.on.take(|on| scene.fill_on(on));
        let nearest_m = self.blind_m + BEYOND_M;
        self.view.take(|view| scene.fill_view(&stands, self.half_width_m, nearest_m, view));
        self.runs.take(&blocked, &self.stencils);
        let [roomy, narrow] =
            self.stencils.each_ref().map(|stencils| stencils.beginning(&self.runs, scene.at));
        let narrow = narrow?;
        if let Some(blinders) = &self.blinders {
            self.wave.shun(&window(&stands), blinders);
        }
        // First without room: where no such way leads, none with room does.
        let (way, steps, spreads) = self.look(scene, NARROW, &narrow, LONGEST)?;
        // Room beside a way that begins where the robot is not is of no use to it.
        let roomy = roomy.filter(|from| from.off == narrow.off);
        let most = (steps + DETOUR).min(BOTH - spreads);
        let roomy = roomy.and_then(|from| self.look(scene, ROOMY, &from, most));
        Some(roomy.map_or(way, |(way, ..)| way))
    }

    /// A way of one width of at most so many steps, with the number of its steps and of those looked at.
    fn look(
        &mut self,
        scene: &Scene<'_>,
        width: usize,
        from: &Beginning,
        most: usize,
    ) -> Option<(Maneuver, usize, usize)> {
        let Self { stencils, runs, wave, on, view, .. } = self;
        wave.begin(&stencils[width], runs, from);
        let along = scene.along();
        let mut seen_from = None;
        for step in 1..=most {
            if !wave.spread() {
                return seen_from.map(|(way, steps)| (way, steps, step));
            }
            let way = |asked: &Asked| {
                let place = wave.meets(asked, |place| scene.cost(along, place))?;
                scene.legs(wave, place).map(|way| (way, step))
            };
            if let Some((way, steps)) = way(on) {
                return Some((way, steps, step));
            }
            seen_from = seen_from.or_else(|| way(view));
        }
        seen_from.map(|(way, steps)| (way, steps, most))
    }
}

fn has(rows: &Rows, x_m: f32, y_m: f32) -> bool {
    let [row, bit] = [x_m, y_m].map(|m| m / CELL_M + HALF_MAP);
    let is_inside = |cell: f32| (0.0..SAFETY_SIDE as f32).contains(&cell);
    // Not negative, so the cast rounds down.
    is_inside(row) && is_inside(bit) && rows[row as usize] >> bit as u32 & 1 == 1
}

impl Scene<'_> {
    /// Towards the goal, as a vector of length 1.
    fn along(&self) -> [f32; 2] {
        let (x, y) = (self.goal_m[0] - self.at.x_m, self.goal_m[1] - self.at.y_m);
        let range = libm::hypotf(x, y);
        if range > 1e-3 { [x / range, y / range] } else { [self.at.cos, self.at.sin] }
    }

    /// How far a place lies beside the line along a direction, and how far it is turned from it: metres and 1 - cosine.
    fn cost(&self, [ux, uy]: [f32; 2], place: &Place) -> f32 {
        let [hx, hy] = direction(place.heading);
        let (x, y) = (middle_m(place.row) - self.at.x_m, middle_m(place.bit) - self.at.y_m);
        (x * uy - y * ux).abs() + 1.0 - (hx * ux + hy * uy)
    }

    /// Places farther on towards the goal, in headings that lead there; none where there is not so much way left.
    fn fill_on(&self, on: &mut Layer) {
        let [ux, uy] = self.along();
        let facing: [u64; HEADINGS] = std::array::from_fn(|heading| {
            let [x, y] = direction(heading);
            if self.left_m >= ON_M && x * ux + y * uy > FACING { u64::MAX } else { 0 }
        });
        let y = |four: usize| f32x4::new([0, 1, 2, 3].map(|bit| middle_m(4 * four + bit) - self.at.y_m));
        let ys: [f32x4; SIDE / 4] = std::array::from_fn(y);
        let (least_m, most_m) = (f32x4::splat(ON_M), f32x4::splat(ASIDE_M));
        for row in 0..SIDE {
            let x = middle_m(row) - self.at.x_m;
            let (along, aside) = (f32x4::splat(x * ux), f32x4::splat(x * uy));
            let word = ys.iter().enumerate().fold(0, |word, (four, y)| {
                let is_on = (along + *y * f32x4::splat(uy)).simd_ge(least_m)
                    & (aside - *y * f32x4::splat(ux)).abs().simd_le(most_m);
                word | u64::from(is_on.to_bitmask()) << (4 * four)
            });
            for (on, facing) in on.iter_mut().zip(&facing) {
                on[row] = word & facing;
            }
        }
    }

    /// `[m]` the nearest cell on the way to the goal that nobody saw, before what stands there: of a line along the middle of
    /// the robot and two along its sides.
    fn unseen(&self, stands: &Rows, half_width_m: f32) -> Option<[f32; 2]> {
        let [ux, uy] = self.along();
        let steps = UNSEEN_M.map(|m| (m / CELL_M) as usize);
        let mut lines = [(0.0, true), (half_width_m, true), (-half_width_m, true)];
        (steps[0]..steps[1]).find_map(|step| {
            let ahead_m = step as f32 * CELL_M;
            lines.iter_mut().find_map(|(aside_m, is_open)| {
                let x_m = self.at.x_m + ahead_m * ux - *aside_m * uy;
                let y_m = self.at.y_m + ahead_m * uy + *aside_m * ux;
                *is_open &= !has(stands, x_m, y_m);
                (*is_open && has(self.unknown, x_m, y_m)).then_some([x_m, y_m])
            })
        })
    }

    /// Places from `nearest_m` on from which that cell is seen past what stands there, in the heading that faces it.
    fn fill_view(&self, stands: &Rows, half_width_m: f32, nearest_m: f32, view: &mut Layer) {
        let Some([x_m, y_m]) = self.unseen(stands, half_width_m) else { return };
        for number in 0..VIEWS {
            let (dy, dx) = libm::sincosf(std::f32::consts::TAU * number as f32 / VIEWS as f32);
            let back = |heading: &usize| {
                let [x, y] = direction(*heading);
                -x * dx - y * dy
            };
            let heading = (0..HEADINGS).max_by(|a, b| back(a).total_cmp(&back(b))).unwrap_or(0);
            for step in 1..=(VIEW_M / CELL_M) as usize {
                let range_m = step as f32 * CELL_M;
                let (from_x_m, from_y_m) = (x_m + range_m * dx, y_m + range_m * dy);
                if has(stands, from_x_m, from_y_m) {
                    break;
                }
                if let (Some(row), Some(bit)) = (index(from_x_m), index(from_y_m))
                    && range_m >= nearest_m
                {
                    view[heading][row] |= 1 << bit;
                }
            }
        }
    }

    /// The legs to a place, from a turn to the heading that the way begins in.
    fn legs(&self, wave: &Wave, to: Place) -> Option<Maneuver> {
        let mut legs = [Leg::zeroed(); LEGS];
        let (mut count, mut last, mut turns) = (0, None, 0);
        for (place, by) in wave.way(to) {
            let kind = match by {
                Some(Step::Forward) => Kind::Forward,
                Some(Step::Back) => Kind::Back,
                _ => Kind::Turn,
            };
            if by.is_none() || last != Some(kind) || turns == TURNS {
                *legs.get_mut(count)? = Leg::new(kind, self.pose(&place));
                (count, turns) = (count + 1, 0);
            }
            turns += usize::from(kind == Kind::Turn);
            last = Some(kind);
        }
        let legs = &mut legs[..count];
        legs.reverse();
        Maneuver::new(legs)
    }

    /// The pose of a place, in `odom`.
    fn pose(&self, place: &Place) -> Pose2 {
        let [cos, sin] = direction(place.heading);
        let (x_m, y_m) = self.frame.transform(f64::from(middle_m(place.row)), f64::from(middle_m(place.bit)));
        Pose2::new(x_m, y_m, self.frame.yaw_rad + f64::from(libm::atan2f(sin, cos)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clearance::heading;
    use crate::fixture::loomo;
    use proptest::prelude::*;
    use sidestep_msgs::wrap_angle;

    const MARGIN_M: f32 = 0.025;

    fn rows(is_set: impl Fn(f32, f32) -> bool) -> Rows {
        std::array::from_fn(|row| {
            (0..SAFETY_SIDE).fold(0, |bits, bit| {
                let [x_m, y_m] = [row, bit].map(|cell| (cell as f32 - 39.5) * CELL_M);
                bits | u128::from(is_set(x_m, y_m)) << bit
            })
        })
    }

    /// The legs of the way out from a pose, among what stands and what nobody saw.
    fn found(stands: &Rows, unknown: &Rows, from: &Pose2, goal_m: [f32; 2]) -> Option<Vec<Leg>> {
        let robot = loomo();
        let outline = Outline::new(&robot).unwrap();
        let blocked: Rows = std::array::from_fn(|row| stands[row] | unknown[row]);
        let at = heading(&Pose2::ORIGIN, from);
        let frame = &Pose2::ORIGIN;
        let scene = Scene { frame, at: &at, blocked: &blocked, unknown, goal_m, left_m: 9.0 };
        let mut planner = Planner::new(&robot, &outline, MARGIN_M);
        planner.find(&scene).map(|maneuver| maneuver.legs().to_vec())
    }

    fn end(legs: &[Leg]) -> Pose2 {
        legs.last().unwrap().end
    }

    /// In the open, wherever the goal lies: on, near the line to it, by turns to its side.
    #[test]
    fn in_the_open_it_leads_on_towards_the_goal() {
        let none = rows(|_, _| false);
        for part in 0..24 {
            let goal_rad = std::f64::consts::TAU * (f64::from(part) + 0.3) / 24.0;
            let (sin, cos) = libm::sincos(goal_rad);
            let goal_m = [1.5 * cos as f32, 1.5 * sin as f32];
            let legs = found(&none, &none, &Pose2::ORIGIN, goal_m).unwrap();
            let end = end(&legs);
            let (on_m, aside_m) = (end.x_m * cos + end.y_m * sin, end.y_m * cos - end.x_m * sin);
            assert!((0.6..0.85).contains(&on_m) && aside_m.abs() < 0.45, "{part}: {legs:?}");
            assert!(wrap_angle(end.yaw_rad - goal_rad).abs() < 0.65 && legs.len() < 6, "{part}: {legs:?}");
        }
    }

    /// Of more than half a circle the first leg says to which side: the other one is blocked.
    #[test]
    fn no_turn_of_a_leg_is_half_a_circle() {
        let none = rows(|_, _| false);
        for part in 0..24 {
            let yaw_rad = std::f64::consts::TAU * f64::from(part) / 24.0;
            let post = rows(|x, y| libm::hypotf(x - 0.22, y + 0.22) < 0.04);
            let from = Pose2::new(0.0, 0.0, yaw_rad);
            for legs in
                [&none, &post].into_iter().filter_map(|stands| found(stands, &none, &from, [1.5, 0.0]))
            {
                let turns = legs.windows(2).map(|legs| wrap_angle(legs[1].end.yaw_rad - legs[0].end.yaw_rad));
                assert!(turns.into_iter().all(|turn| turn.abs() < 2.9), "{legs:?}");
            }
        }
    }

    /// Where the last goal is nearer than a way on leads, none is looked for.
    #[test]
    fn nobody_is_led_past_the_last_goal() {
        let none = rows(|_, _| false);
        let at = heading(&Pose2::ORIGIN, &Pose2::ORIGIN);
        let robot = loomo();
        let mut planner = Planner::new(&robot, &Outline::new(&robot).unwrap(), MARGIN_M);
        let mut find = |left_m: f32| {
            let frame = &Pose2::ORIGIN;
            planner.find(&Scene {
                frame,
                at: &at,
                blocked: &none,
                unknown: &none,
                goal_m: [0.4, 0.0],
                left_m,
            })
        };
        assert!(find(0.4).is_none() && find(2.0).is_some() && find(0.4).is_none());
    }

    /// A robot of the largest radius with the widest margin too.
    #[test]
    fn large_robots_are_led_on_as_well() {
        let found = |half_m: f32| {
            let mut robot = loomo();
            let h = half_m;
            robot.footprint.polygon_m = vec![[h, -h], [h, h], [-h, h], [-h, -h]];
            let outline = Outline::new(&robot).unwrap();
            let none = rows(|_, _| false);
            let at = heading(&Pose2::ORIGIN, &Pose2::ORIGIN);
            let frame = &Pose2::ORIGIN;
            let scene =
                Scene { frame, at: &at, blocked: &none, unknown: &none, goal_m: [1.5, 0.0], left_m: 9.0 };
            Planner::new(&robot, &outline, 0.2).find(&scene).is_some()
        };
        assert_eq!([0.3, 0.42, 0.63].map(found), [true; 3]);
    }

    /// A gap that there is no room beside, in a wall: the way round its end has room, but is 0.9 m aside.
    #[test]
    fn a_gap_without_room_is_taken_before_a_long_way_round() {
        let none = rows(|_, _| false);
        for half_gap_m in [0.35, 0.45] {
            let wall = rows(|x, y| (0.55..0.65).contains(&x) && (half_gap_m..0.5).contains(&y.abs()));
            let legs = found(&wall, &none, &Pose2::ORIGIN, [1.8, 0.0]).unwrap();
            assert!(legs.iter().all(|leg| leg.end.y_m.abs() < 0.1), "{half_gap_m}: {legs:?}");
        }
    }

    /// A slot that is closed ahead and open behind, too narrow to turn in, and a goal beside it.
    #[test]
    fn out_of_a_slot_it_leads_back_and_round() {
        let slot = rows(|x, y| x > -0.4 && (x > 0.25 || y.abs() > 0.34) && y.abs() < 0.6);
        let none = rows(|_, _| false);
        let legs = found(&slot, &none, &Pose2::ORIGIN, [-0.8, 1.5]).unwrap();
        let end = end(&legs);
        assert!(legs[1].end.x_m < -0.4 && end.y_m > 0.3, "{legs:?}");
        let closed = rows(|x, y| x.abs() > 0.25 || y.abs() > 0.34);
        assert_eq!(found(&closed, &none, &Pose2::ORIGIN, [-0.8, 1.5]), None);
    }

    /// A wall that the camera would be too near to see: no way ends in front of it, facing it.
    #[test]
    fn no_camera_is_led_in_front_of_a_wall() {
        let none = rows(|_, _| false);
        let ends = |wall_m: f32| {
            let wall = rows(|x, y| x > wall_m && y.abs() < 1.0);
            found(&wall, &none, &Pose2::ORIGIN, [1.5, 0.0]).map(|legs| end(&legs))
        };
        let (near, far) = (ends(1.0), ends(1.3));
        assert!(far.is_some_and(|end| end.x_m > 0.6), "{far:?}");
        assert!(near.is_none_or(|end| end.yaw_rad.abs() > 0.1), "{near:?}");
    }

    /// A band of unseen floor across the way: it is looked at from farther off than the camera's blind spot, facing it; from
    /// behind a wall it is not.
    #[test]
    fn what_nobody_saw_is_looked_at_from_where_it_is_seen() {
        let none = rows(|_, _| false);
        let band = rows(|_, y| y > 0.4);
        let legs = found(&none, &band, &Pose2::ORIGIN, [0.0, 2.0]).unwrap();
        let end = end(&legs);
        let (x_m, y_m) = end.inverse_transform(0.0, 0.425);
        let bearing_rad = libm::atan2(y_m, x_m);
        let blind_m = f64::from(loomo().blind_m());
        assert!(libm::hypot(x_m, y_m) > blind_m && bearing_rad.abs() < 0.3, "{end:?} {x_m} {y_m}");
        let wall = rows(|x, y| (0.35..0.4).contains(&y) && x.abs() < 1.9);
        assert_eq!(found(&wall, &band, &Pose2::ORIGIN, [0.0, 2.0]), None);
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 2000, max_global_rejects: 20_000, ..ProptestConfig::default() })]

        /// Boxes and unseen patches anywhere but where the robot stands: no pose on any leg touches a cell that is not
        /// free.
        #[test]
        fn no_leg_touches_what_is_not_free(
            boxes in proptest::array::uniform12((-1.8_f32..1.8, -1.8_f32..1.8, 0.05_f32..0.25)),
            yaw_rad in -3.1_f64..3.1,
        ) {
            let robot = loomo();
            let outline = Outline::new(&robot).unwrap();
            let among = |boxes: &[(f32, f32, f32)]| rows(|x, y| {
                let is_in = |(bx, by, half): &(f32, f32, f32)| (x - bx).abs().max((y - by).abs()) < *half;
                libm::hypotf(x, y) > 0.4 && boxes.iter().any(is_in)
            });
            let (stands, unknown) = (among(&boxes[..7]), among(&boxes[7..]));
            let blocked: Rows = std::array::from_fn(|row| stands[row] | unknown[row]);
            let legs = found(&stands, &unknown, &Pose2::new(0.0, 0.0, yaw_rad), [1.8, 0.3]);
            prop_assume!(legs.is_some());
            let legs = legs.unwrap();
            for (from, to) in legs.iter().zip(&legs[1..]).map(|(from, to)| (from.end, to.end)) {
                let turn_rad = wrap_angle(to.yaw_rad - from.yaw_rad);
                for part in (0..=20).map(|part| f64::from(part) / 20.0) {
                    let between = |from: f64, to: f64| from + part * (to - from);
                    let (x_m, y_m) = (between(from.x_m, to.x_m), between(from.y_m, to.y_m));
                    let pose = Pose2::new(x_m, y_m, from.yaw_rad + part * turn_rad);
                    let at = heading(&Pose2::ORIGIN, &pose);
                    prop_assert_eq!(outline.blocked(&at, 0.0, &blocked), None, "{:?} {:?}", &legs, pose);
                }
            }
        }
    }
}

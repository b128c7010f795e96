//! Turns on the spot and straights, one after another, and how they are driven.

use crate::config::Config;
use bytemuck::{Pod, Zeroable};
use sidestep_msgs::{Pose2, Twist, wrap_angle};

/// Most legs.
pub(crate) const LEGS: usize = 8;
/// `[rad]` a turn is done this near to its end; the first one, which begins anywhere, sooner: the straight after it steers.
const TURNED_RAD: f64 = 0.06;
const TURNED_FIRST_RAD: f64 = 0.25;
/// `[m]` a straight is done this near to its end.
const THERE_M: f64 = 0.03;
/// `[m/s]` fastest straight forward, and `[m/s2]` braking before its end down to `[m/s]`.
const FORWARD_M_S: f32 = 0.4;
const BRAKE_M_S2: f32 = 0.3;
const LAST_M_S: f32 = 0.05;
/// `[1/s]` and `[rad/s]`: gain and least rate of a turn; gain by angle and by metre, and highest rate, on a straight.
const TURN_GAIN: f32 = 3.0;
const TURN_LEAST_RAD_S: f32 = 0.15;
const STEER_GAIN: f32 = 2.0;
const STEER_MOST_RAD_S: f32 = 0.6;

/// What a leg is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u64)]
pub(crate) enum Kind {
    Turn = 0,
    Forward = 1,
    Back = 2,
}

/// A turn on the spot, or a straight, in `odom`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Leg {
    /// Where it ends.
    pub(crate) end: Pose2,
    /// [`Kind`] code.
    kind: u64,
}

impl Leg {
    pub(crate) fn new(kind: Kind, end: Pose2) -> Self {
        Self { end, kind: kind as u64 }
    }
}

/// Legs one after another, and which of them is driven.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Maneuver {
    legs: [Leg; LEGS],
    count: u32,
    at: u32,
}

impl Maneuver {
    /// `None` for more legs than there is room for.
    pub(crate) fn new(legs: &[Leg]) -> Option<Self> {
        let mut maneuver = Self { count: legs.len() as u32, ..Self::zeroed() };
        maneuver.legs.get_mut(..legs.len())?.copy_from_slice(legs);
        Some(maneuver)
    }

    pub(crate) fn legs(&self) -> &[Leg] {
        self.legs.get(self.at as usize..self.count as usize).unwrap_or(&[])
    }

    /// Leaves the legs behind that are done at a pose; whether none is left.
    pub(crate) fn is_over(&mut self, pose: &Pose2) -> bool {
        while let [leg, ..] = self.legs() {
            let (x_m, _) = pose.inverse_transform(leg.end.x_m, leg.end.y_m);
            let off_rad = wrap_angle(leg.end.yaw_rad - pose.yaw_rad).abs();
            let is_done = match leg.kind {
                kind if kind == Kind::Forward as u64 => x_m < THERE_M,
                kind if kind == Kind::Back as u64 => x_m > -THERE_M,
                _ => off_rad < if self.at == 0 { TURNED_FIRST_RAD } else { TURNED_RAD },
            };
            if !is_done {
                return false;
            }
            self.at += 1;
        }
        true
    }

    /// What to drive at a pose.
    pub(crate) fn wish(&self, pose: &Pose2, config: &Config) -> Twist {
        let [leg, ..] = self.legs() else { return Twist::STOP };
        let (x_m, y_m) = pose.inverse_transform(leg.end.x_m, leg.end.y_m);
        let (x_m, y_m) = (x_m as f32, y_m as f32);
        let off_rad = wrap_angle(leg.end.yaw_rad - pose.yaw_rad) as f32;
        let speed = |most: f32| (LAST_M_S + libm::sqrtf(2.0 * BRAKE_M_S2 * x_m.abs())).min(most);
        let steer = |y_m: f32| (STEER_GAIN * (off_rad + y_m)).clamp(-STEER_MOST_RAD_S, STEER_MOST_RAD_S);
        match leg.kind {
            kind if kind == Kind::Forward as u64 => Twist::new(speed(FORWARD_M_S), steer(y_m)),
            kind if kind == Kind::Back as u64 => Twist::new(-speed(config.back_up_m_s), steer(-y_m)),
            _ => {
                let rate = TURN_LEAST_RAD_S + TURN_GAIN * off_rad.abs();
                Twist::new(0.0, off_rad.signum() * rate.min(config.escape_turn_rad_s))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Drives a maneuver with a base that does at once what it is told; where it ends, and after how many ticks of 10 ms.
    fn driven(legs: &[Leg], from: Pose2) -> (Pose2, usize) {
        let mut maneuver = Maneuver::new(legs).unwrap();
        let mut pose = from;
        let ticks = (0..3000).find(|_| {
            let is_over = maneuver.is_over(&pose);
            pose = pose.advance(&maneuver.wish(&pose, &Config::STANDARD), 0.01);
            is_over
        });
        (pose, ticks.unwrap())
    }

    #[test]
    fn it_ends_where_its_last_leg_ends_though_it_began_beside_the_first() {
        let legs = [
            Leg::new(Kind::Turn, Pose2::new(0.0, 0.0, 0.0)),
            Leg::new(Kind::Back, Pose2::new(-0.5, 0.0, 0.0)),
            Leg::new(Kind::Turn, Pose2::new(-0.5, 0.0, 1.0)),
            Leg::new(Kind::Forward, Pose2::new(-0.5 + 0.6 * libm::cos(1.0), 0.6 * libm::sin(1.0), 1.0)),
        ];
        for (aside_m, yaw_rad) in [(0.0, 0.0), (0.03, 0.2), (-0.03, -0.2), (0.0, 3.0)] {
            let (end, ticks) = driven(&legs, Pose2::new(0.0, aside_m, yaw_rad));
            let off_m = end.distance_m(&legs[3].end);
            assert!(off_m < 0.08 && (end.yaw_rad - 1.0).abs() < 0.1, "{aside_m} {yaw_rad}: {end:?}");
            assert!((400..1000).contains(&ticks), "{ticks}");
        }
    }

    #[test]
    fn more_legs_than_there_is_room_for_are_no_maneuver() {
        let leg = Leg::new(Kind::Turn, Pose2::ORIGIN);
        assert!(Maneuver::new(&[leg; LEGS]).is_some_and(|maneuver| maneuver.legs().len() == LEGS));
        assert_eq!(Maneuver::new(&[leg; LEGS + 1]), None);
    }
}

//! The members of the identified set of the actuator: who among them is simulated.

use sidestep_msgs::Robot;

/// Members that are simulated side by side, four to a register.
pub(crate) type Fours<const COUNT: usize> = [[Member; LANES]; COUNT];
pub(crate) const LANES: usize = 4;
/// Fours of members that come to rest last, and of the others.
pub(crate) const FARTHEST: usize = 1;
pub(crate) const OTHERS: usize = 4;

/// How a member comes to rest once the candidate has run out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Stop {
    /// The arbiter commands it, along the curve.
    Told,
    /// Nobody does: each axis stops for itself.
    Alone {
        /// `[s]` from when the candidate was sent.
        after_s: f32,
        /// `[rad/s^2]` fastest change of its turn rate.
        turn_rad_s2: f32,
    },
}

/// A member of the identified set of the actuator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Member {
    /// `[s]` dead time.
    pub(crate) dead_s: f32,
    /// `[m/s^2]` strongest deceleration.
    pub(crate) brake_m_s2: f32,
    /// `[m/s]` how much faster it drives than told to, or slower, but not the other way.
    pub(crate) error_m_s: f32,
    /// `[rad/s]` error of its turn rate while it is told to move.
    pub(crate) error_rad_s: f32,
    pub(crate) stop: Stop,
}

impl Member {
    /// Whether it follows without errors what it is told.
    pub(crate) fn is_faithful(&self) -> bool {
        self.error_m_s == 0.0 && self.error_rad_s == 0.0
    }

    /// `[s]` when its stop begins, given the age of the state and how long the candidate holds.
    pub(crate) fn stops_s(&self, age_s: f32, hold_s: f32) -> f32 {
        match self.stop {
            Stop::Told => age_s + self.dead_s + hold_s,
            Stop::Alone { after_s, .. } => age_s + after_s,
        }
    }

    /// Whether two are told the same at the same times.
    pub(crate) fn is_told_like(&self, other: &Self) -> bool {
        let alone_s = |member: &Self| match member.stop {
            Stop::Told => None,
            Stop::Alone { after_s, .. } => Some(after_s.to_bits()),
        };
        self.dead_s.to_bits() == other.dead_s.to_bits() && alone_s(self) == alone_s(other)
    }

    /// `[rad/s^2]` fastest change of its turn rate.
    pub(crate) fn turn_rad_s2(&self) -> f32 {
        match self.stop {
            Stop::Told => f32::MAX,
            Stop::Alone { turn_rad_s2, .. } => turn_rad_s2,
        }
    }
}

/// The members of the identified set that are simulated: those that come to rest last, and the others, among which those
/// that are told the same come one after the other. Whoever brakes harder is at rest before an error has led him as far. A
/// base left alone stops when the candidate runs out, or later by the longest dead time, its turn at once or slowly. An
/// error that changes sides midway leads the rear of the Loomo up to 6 mm farther aside than either side alone, on a
/// straight way: the margin takes that.
pub(crate) fn members(robot: &Robot, hold_s: f32) -> (Fours<FARTHEST>, Fours<OTHERS>) {
    let a = &robot.actuator;
    let (soon_s, late_s) = (a.dead_time_min_s, a.dead_time_max_s);
    let (weak, strong) = (a.brake_min_m_s2, a.brake_max_m_s2.max(a.brake_min_m_s2));
    let (v, w) = (a.tracking_m_s, a.tracking_rad_s);
    let told = |dead_s, brake_m_s2| Member {
        dead_s,
        brake_m_s2,
        error_m_s: 0.0,
        error_rad_s: 0.0,
        stop: Stop::Told,
    };
    let errs = |member, error_m_s, error_rad_s| Member { error_m_s, error_rad_s, ..member };
    let (at_once, slowly) = (f32::MAX, robot.limits.turn_accelerate_rad_s2);
    let alone =
        |member, after_s, turn_rad_s2| Member { stop: Stop::Alone { after_s, turn_rad_s2 }, ..member };
    let (late, soon) = (told(late_s, weak), told(soon_s, weak));
    let last = alone(late, hold_s + late_s, slowly);
    let farthest = [[late, errs(late, v, w), errs(late, v, -w), last]];
    let others = [
        [errs(late, -v, w), errs(late, -v, -w), told(late_s, strong), soon],
        [
            errs(soon, v, w),
            errs(soon, v, -w),
            told(soon_s, strong),
            told(0.5 * (soon_s + late_s), 0.5 * (weak + strong)),
        ],
        [
            errs(last, v, w),
            errs(last, v, -w),
            alone(late, hold_s + late_s, at_once),
            alone(told(late_s, strong), hold_s + late_s, slowly),
        ],
        [
            alone(late, hold_s, slowly),
            alone(soon, hold_s, slowly),
            alone(soon, hold_s, at_once),
            alone(told(soon_s, strong), hold_s, slowly),
        ],
    ];
    (farthest, others)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::fixture::loomo;

    /// To whichever side a member errs, another errs as much to the other; none is simulated twice.
    #[test]
    fn the_members_are_different_ones_and_mirrored() {
        let (farthest, others) = members(&loomo(), Config::STANDARD.hold_s);
        let all = [farthest.as_flattened(), others.as_flattened()].concat();
        for (number, member) in all.iter().enumerate() {
            assert!(!all[..number].contains(member), "{member:?}");
            let mirrored = Member { error_rad_s: -member.error_rad_s, ..*member };
            assert!(all.contains(&mirrored), "{member:?}");
        }
        let a = loomo().actuator;
        let ends = |of: fn(&Member) -> f32| {
            all.iter().map(of).fold((f32::MAX, f32::MIN), |(least, most), it| (least.min(it), most.max(it)))
        };
        assert_eq!(ends(|member| member.dead_s), (a.dead_time_min_s, a.dead_time_max_s));
        assert_eq!(ends(|member| member.brake_m_s2), (a.brake_min_m_s2, a.brake_max_m_s2));
        assert_eq!(ends(|member| member.error_m_s), (-a.tracking_m_s, a.tracking_m_s));
        assert_eq!(ends(|member| member.error_rad_s), (-a.tracking_rad_s, a.tracking_rad_s));
    }
}

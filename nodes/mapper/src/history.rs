//! Where the robot was: odometry of the last moments, so that a frame is placed at its capture stamp and not at its
//! arrival, and how much the pose may have drifted meanwhile.

use sidestep_msgs::{Odometry, Pose2, Robot, Status, Twist};

/// Samples kept: 0.64 s at 100 Hz.
pub(crate) const SAMPLES: usize = 64;
/// `[ns]` longest extrapolation beyond the newest sample (SPEC section 3).
const EXTRAPOLATE_MAX_NS: u64 = 20_000_000;
/// `[m]` and [m/s]: a step longer and faster than this is a jump that nobody announced.
const JUMP_M: f64 = 0.3;
const JUMP_M_S: f64 = 10.0;
/// `[ns]` a stamp that runs backward by more than this begins the history anew: the one before it was wrong.
const RESTART_NS: u64 = 1_000_000_000;

/// One moment of the body.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C)]
pub(crate) struct Sample {
    /// `[ns]` graph time.
    pub(crate) stamp_ns: u64,
    /// Pose of `base` in `odom`.
    pub(crate) pose: Pose2,
    /// Velocity in `base`.
    pub(crate) twist: Twist,
    /// `[rad]` roll of `body`.
    pub(crate) roll_rad: f32,
    /// `[rad]` pitch of `body`, nose down positive.
    pub(crate) pitch_rad: f32,
}

/// What a new odometry message means for the map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Arrival {
    /// Taken.
    Continuous,
    /// Taken, and the pose jumped: what was placed before is void.
    Jumped,
    /// Not usable.
    Ignored,
}

/// The ring of samples with the drift accumulated over them.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C)]
pub(crate) struct History {
    /// `[m]` pose error expected to have accumulated since the start.
    pub(crate) drift_m: f64,
    /// `[m]` the part of it that turns made, at the lever.
    pub(crate) turned_m: f64,
    /// Pose epoch of all samples.
    pub(crate) pose_epoch: u32,
    /// 1 when the newest message was not finite.
    unfit: u32,
    count: u64,
    next: u64,
    samples: [Sample; SAMPLES],
}

impl History {
    pub(crate) fn new() -> Self {
        bytemuck::Zeroable::zeroed()
    }

    fn sample(&self, back: u64) -> &Sample {
        &self.samples[(self.next + SAMPLES as u64 - 1 - back) as usize % SAMPLES]
    }

    /// Takes one message.
    pub(crate) fn push(&mut self, odometry: &Odometry, robot: &Robot, lever_m: f32) -> Arrival {
        let attitude = odometry.roll_rad.abs().max(odometry.pitch_rad.abs());
        let within = odometry.pose.x_m.abs() < 1e6 && odometry.pose.y_m.abs() < 1e6 && attitude < 1.5;
        let attitude_finite = odometry.roll_rad.is_finite() && odometry.pitch_rad.is_finite();
        if !(odometry.pose.is_finite() && odometry.twist.is_finite() && attitude_finite && within) {
            self.unfit = 1;
            return Arrival::Ignored;
        }
        self.unfit = 0;
        let mut arrival = Arrival::Continuous;
        if self.count > 0 {
            let last = *self.sample(0);
            if odometry.pose_epoch != self.pose_epoch {
                arrival = Arrival::Jumped;
            } else if odometry.stamp_ns <= last.stamp_ns {
                if last.stamp_ns - odometry.stamp_ns <= RESTART_NS {
                    return Arrival::Ignored;
                }
                self.count = 0;
            } else {
                let step_m = last.pose.distance_m(&odometry.pose);
                let step_s = (odometry.stamp_ns - last.stamp_ns) as f64 * 1e-9;
                if step_m > JUMP_M && step_m > JUMP_M_S * step_s {
                    arrival = Arrival::Jumped;
                }
                let turn = sidestep_msgs::wrap_angle(odometry.pose.yaw_rad - last.pose.yaw_rad).abs();
                let start = &robot.start;
                let turned_m = f64::from(start.drift_per_rad) * f64::from(lever_m) * turn;
                self.turned_m += turned_m;
                self.drift_m += f64::from(start.drift_per_m) * step_m + turned_m;
            }
        }
        if arrival == Arrival::Jumped {
            self.count = 0;
        }
        self.pose_epoch = odometry.pose_epoch;
        self.samples[self.next as usize % SAMPLES] = Sample {
            stamp_ns: odometry.stamp_ns,
            pose: odometry.pose,
            twist: odometry.twist,
            roll_rad: odometry.roll_rad,
            pitch_rad: odometry.pitch_rad,
        };
        self.next = (self.next + 1) % SAMPLES as u64;
        self.count = (self.count + 1).min(SAMPLES as u64);
        arrival
    }

    /// The body at a stamp: interpolated between samples, or extrapolated by at most 20 ms beyond the newest.
    pub(crate) fn at(&self, stamp_ns: u64, gap_s: f32) -> Result<Sample, Status> {
        let missing = if self.unfit != 0 { Status::RefusedPose } else { Status::RefusedOdometry };
        if self.count == 0 {
            return Err(missing);
        }
        let newest = self.sample(0);
        if stamp_ns >= newest.stamp_ns {
            let ahead_ns = stamp_ns - newest.stamp_ns;
            if ahead_ns > EXTRAPOLATE_MAX_NS {
                return Err(missing);
            }
            let pose = newest.pose.advance(&newest.twist, ahead_ns as f64 * 1e-9);
            return Ok(Sample { stamp_ns, pose, ..*newest });
        }
        for back in 1..self.count {
            let (before, after) = (self.sample(back), self.sample(back - 1));
            if stamp_ns < before.stamp_ns {
                continue;
            }
            if stamp_ns == before.stamp_ns {
                return Ok(*before);
            }
            let span_ns = after.stamp_ns - before.stamp_ns;
            if span_ns as f64 > f64::from(gap_s) * 1e9 {
                return Err(Status::RefusedOdometry);
            }
            let part = (stamp_ns - before.stamp_ns) as f64 / span_ns as f64;
            let mix = |a: f32, b: f32| a + (b - a) * part as f32;
            return Ok(Sample {
                stamp_ns,
                pose: before.pose.interpolate(&after.pose, part),
                twist: after.twist,
                roll_rad: mix(before.roll_rad, after.roll_rad),
                pitch_rad: mix(before.pitch_rad, after.pitch_rad),
            });
        }
        Err(Status::RefusedOdometry)
    }

    /// Whether counters read from outside can be trusted as indices and the numbers are finite.
    pub(crate) fn is_sound(&self) -> bool {
        let ring = self.count <= SAMPLES as u64 && self.next < SAMPLES as u64;
        let finite = |s: &Sample| s.pose.is_finite() && s.roll_rad.is_finite() && s.pitch_rad.is_finite();
        ring && (self.drift_m + self.turned_m).is_finite()
            && self.samples.iter().all(|s| finite(s) && s.twist.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn robot() -> Robot {
        Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml")).unwrap()
    }

    fn message(stamp_ns: u64, x_m: f64) -> Odometry {
        let pose = Pose2::new(x_m, 0.0, 0.0);
        Odometry {
            stamp_ns,
            pose,
            pitch_rad: 0.1 * x_m as f32,
            twist: Twist::new(1.0, 0.0),
            ..Odometry::default()
        }
    }

    /// Samples every 10 ms at 1 m/s: between them, on them, beyond the newest and before the oldest.
    #[test]
    fn the_pose_is_interpolated_and_extrapolated_by_20_ms_and_no_more() {
        let (mut history, robot) = (History::new(), robot());
        assert_eq!(history.at(1, 0.15), Err(Status::RefusedOdometry));
        for step in 1..=100u64 {
            assert_eq!(
                history.push(&message(step * 10_000_000, step as f64 * 0.01), &robot, 1.0),
                Arrival::Continuous
            );
        }
        for (stamp_ns, x_m) in [(990_000_000, 0.99), (994_000_000, 0.994), (1_020_000_000, 1.02)] {
            let sample = history.at(stamp_ns, 0.15).unwrap();
            assert!((sample.pose.x_m - x_m).abs() < 1e-9, "{stamp_ns}: {}", sample.pose.x_m);
            assert!((f64::from(sample.pitch_rad) - 0.1 * x_m.min(1.0)).abs() < 1e-6);
        }
        assert_eq!(history.at(1_020_000_001, 0.15), Err(Status::RefusedOdometry));
        assert_eq!(history.at(300_000_000, 0.15), Err(Status::RefusedOdometry));
        let _ = history.push(&message(1_300_000_000, 1.3), &robot, 1.0);
        assert_eq!(history.at(1_100_000_000, 0.15), Err(Status::RefusedOdometry), "a gap of 0.3 s");
    }

    #[test]
    fn jumps_are_told_apart_from_driving_and_from_lost_messages() {
        let (mut history, robot) = (History::new(), robot());
        let mut push = |odometry: &Odometry| history.push(odometry, &robot, 1.0);
        assert_eq!(push(&message(10_000_000, 0.0)), Arrival::Continuous);
        assert_eq!(push(&message(20_000_000, 0.02)), Arrival::Continuous);
        assert_eq!(push(&message(20_000_000, 0.02)), Arrival::Ignored, "repeated");
        assert_eq!(push(&message(30_000_000, 0.5)), Arrival::Jumped, "48 m/s");
        assert_eq!(push(&message(2_030_000_000, 2.5)), Arrival::Continuous, "2 s without messages");
        assert_eq!(push(&Odometry { pose_epoch: 1, ..message(2_040_000_000, 2.5) }), Arrival::Jumped);
        assert_eq!(push(&Odometry { roll_rad: f32::NAN, ..message(2_050_000_000, 2.5) }), Arrival::Ignored);
        assert_eq!(
            push(&Odometry { pose_epoch: 1, ..message(10, 2.5) }),
            Arrival::Continuous,
            "the clock was wrong"
        );
    }

    /// 10 m straight and 10 rad turned, with 1 % and 0.5 % at a lever of 1 m.
    #[test]
    fn drift_grows_with_way_and_turn() {
        let (mut history, robot) = (History::new(), robot());
        for step in 0..=1000u64 {
            let pose = Pose2::new(step as f64 * 0.01, 0.0, sidestep_msgs::wrap_angle(step as f64 * 0.01));
            let _ = history.push(&Odometry { pose, ..message((step + 1) * 10_000_000, 0.0) }, &robot, 1.0);
        }
        assert!((history.drift_m - 0.15).abs() < 1e-6, "{}", history.drift_m);
        assert!((history.turned_m - 0.05).abs() < 1e-6, "{}", history.turned_m);
    }
}

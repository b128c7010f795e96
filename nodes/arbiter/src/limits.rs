//! The next command within the limits: speed, turn rate, acceleration, braking, and jerk where comfort allows.
//!
//! Limits hold relative to the command sent before and to the time since then, whatever is wished.

use bytemuck::{Pod, Zeroable};
use sidestep_msgs::{Limits, Twist};

/// Slower than this [m/s] a command only turns.
const STILL_M_S: f32 = 1e-4;

/// A command with its rate of change.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Motion {
    /// The command.
    pub(crate) twist: Twist,
    /// `[m/s^2]` how the commanded speed changed last.
    pub(crate) acceleration_m_s2: f32,
    /// Zero.
    pub(crate) _pad: u32,
}

impl Motion {
    /// At rest.
    pub(crate) const REST: Self = Self { twist: Twist::STOP, acceleration_m_s2: 0.0, _pad: 0 };

    /// At a steady twist.
    pub(crate) fn steady(twist: Twist) -> Self {
        Self { twist, ..Self::REST }
    }

    /// Whether nothing is commanded.
    pub(crate) fn is_rest(&self) -> bool {
        self.twist.v_m_s.abs() < STILL_M_S && self.twist.w_rad_s.abs() < STILL_M_S
    }
}

/// Keeps commands within the limits.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limiter {
    limits: Limits,
}

impl Limiter {
    pub(crate) fn new(limits: &Limits) -> Self {
        Self { limits: *limits }
    }

    /// A twist within the limits of speed and turn rate; what is not finite stops.
    pub(crate) fn bounded(&self, twist: Twist) -> Twist {
        if !twist.is_finite() {
            return Twist::STOP;
        }
        let l = &self.limits;
        Twist {
            v_m_s: twist.v_m_s.clamp(-l.reverse_m_s, l.forward_m_s),
            w_rad_s: twist.w_rad_s.clamp(-l.turn_rad_s, l.turn_rad_s),
        }
    }

    /// The command `dt_s` after `from` on the way to `wish`.
    ///
    /// The turn rate grows with the speed, so that the path begins on the wished curve.
    pub(crate) fn towards(&self, from: &Motion, wish: Twist, dt_s: f32) -> Motion {
        if dt_s <= 0.0 {
            return *from;
        }
        let l = &self.limits;
        let (v, wish) = (from.twist.v_m_s, self.bounded(wish));
        let (least, most) = self.accelerations(v);
        let missing = wish.v_m_s - v;
        // The acceleration a that falls to zero just as the wish is reached: a dt + a (a - j dt) / 2j = missing.
        let jerk = l.comfort_jerk_m_s3;
        let gentle = jerk * (libm::sqrtf(0.25 * dt_s * dt_s + 2.0 * missing.abs() / jerk) - 0.5 * dt_s);
        let gentle = gentle.min(missing.abs() / dt_s);
        let change = jerk * dt_s;
        // Who stands has no acceleration left but towards the wish: else a brake's would carry the robot past zero.
        let ended = v.abs() < STILL_M_S && from.acceleration_m_s2 * missing <= 0.0;
        let before = if ended { 0.0 } else { from.acceleration_m_s2.clamp(least, most) };
        let acceleration =
            gentle.copysign(missing).clamp(before - change, before + change).clamp(least, most);
        let mut next = (v + acceleration * dt_s).clamp(-l.reverse_m_s, l.forward_m_s);
        if next * v < 0.0 {
            next = 0.0;
        }
        let part = if wish.v_m_s.abs() > 1e-3 { (next / wish.v_m_s).clamp(0.0, 1.0) } else { 1.0 };
        let turn = self.turn(from.twist.w_rad_s, wish.w_rad_s * part, dt_s);
        Motion { twist: Twist::new(next, turn), acceleration_m_s2: (next - v) / dt_s, _pad: 0 }
    }

    /// The command `dt_s` after `from` on the way to rest, along the curve of `from`.
    ///
    /// With `comfort` the jerk is limited; without, the full deceleration begins at once.
    pub(crate) fn brake(&self, from: &Motion, dt_s: f32, comfort: bool) -> Motion {
        let (v, w) = (from.twist.v_m_s, from.twist.w_rad_s);
        if dt_s <= 0.0 {
            return *from;
        }
        if v.abs() < STILL_M_S {
            return Motion { twist: Twist::new(0.0, self.turn(w, 0.0, dt_s)), ..Motion::REST };
        }
        let hardest = self.deceleration(from.twist);
        let along = from.acceleration_m_s2 * v.signum();
        let change = self.limits.comfort_jerk_m_s3 * dt_s;
        let along = if comfort { (along - change).max(-hardest) } else { -hardest };
        let most = if v > 0.0 { self.limits.forward_m_s } else { self.limits.reverse_m_s };
        let speed = (v.abs() + along * dt_s).clamp(0.0, most.max(v.abs()));
        let next = speed.copysign(v);
        let turn = self.turn(w, w * (speed / v.abs()).min(1.0), dt_s);
        Motion { twist: Twist::new(next, turn), acceleration_m_s2: (next - v) / dt_s, _pad: 0 }
    }

    /// `[m/s^2]` how hard a twist may brake so that speed and turn rate reach zero together.
    pub(crate) fn deceleration(&self, twist: Twist) -> f32 {
        let l = &self.limits;
        l.brake_m_s2.min(l.turn_accelerate_rad_s2 * twist.v_m_s.abs() / twist.w_rad_s.abs().max(1e-6))
    }

    /// `[m/s^2]` least and most acceleration of a speed: towards zero is braking.
    fn accelerations(&self, v: f32) -> (f32, f32) {
        let (brake, accelerate) = (self.limits.brake_m_s2, self.limits.accelerate_m_s2);
        if v > STILL_M_S {
            (-brake, accelerate)
        } else if v < -STILL_M_S {
            (-accelerate, brake)
        } else {
            (-accelerate, accelerate)
        }
    }

    fn turn(&self, from: f32, to: f32, dt_s: f32) -> f32 {
        let change = self.limits.turn_accelerate_rad_s2 * dt_s;
        let most = self.limits.turn_rad_s;
        (from + (to - from).clamp(-change, change)).clamp(-most, most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::loomo;
    use proptest::prelude::*;

    fn limiter() -> Limiter {
        Limiter::new(&loomo().limits)
    }

    #[test]
    fn a_wish_beyond_the_limits_is_the_limit() {
        let l = loomo().limits;
        let bounded = |v_m_s, w_rad_s| limiter().bounded(Twist::new(v_m_s, w_rad_s));
        assert_eq!(bounded(9.0, -9.0), Twist::new(l.forward_m_s, -l.turn_rad_s));
        assert_eq!(bounded(-9.0, 9.0), Twist::new(-l.reverse_m_s, l.turn_rad_s));
        assert_eq!(bounded(0.1, f32::INFINITY), Twist::STOP);
    }

    #[test]
    fn a_wish_is_reached_without_passing_it() {
        for wish in [1.0, 0.5, 0.02, -0.2] {
            let mut motion = Motion::REST;
            let mut most: f32 = 0.0;
            for _ in 0..300 {
                motion = limiter().towards(&motion, Twist::new(wish, 0.0), 0.01);
                most = most.max(motion.twist.v_m_s.abs());
            }
            assert!((motion.twist.v_m_s - wish).abs() < 1e-4, "{wish}: {motion:?}");
            assert!(most < wish.abs() + 1e-3, "{wish}: {most}");
        }
    }

    #[test]
    fn braking_keeps_the_curve_and_takes_the_time_of_the_closed_form() {
        // v / b = 0.5 / 0.5 = 1 s; w = 1 rad/s needs 1/3 s by itself and waits for the speed.
        let mut motion = Motion::steady(Twist::new(0.5, 1.0));
        let mut ticks = 0;
        while !motion.is_rest() {
            motion = limiter().brake(&motion, 0.01, false);
            ticks += 1;
            if motion.twist.v_m_s > 0.01 {
                assert!((motion.twist.w_rad_s / motion.twist.v_m_s - 2.0).abs() < 1e-3, "{motion:?}");
            }
        }
        assert!((99..=102).contains(&ticks), "{ticks}");
    }

    /// A brake that ends in this very tick leaves its deceleration behind; the next wish must not be answered with it.
    #[test]
    fn a_wish_right_after_a_stop_never_moves_the_other_way() {
        for wish in [Twist::new(0.15, 0.0), Twist::new(0.0, 0.5), Twist::new(-0.15, 0.0)] {
            for speed in [0.004, -0.004] {
                let mut motion = limiter().brake(&Motion::steady(Twist::new(speed, 0.0)), 0.01, false);
                assert_eq!(motion.twist, Twist::STOP);
                for _ in 0..10 {
                    motion = limiter().towards(&motion, wish, 0.01);
                    let v = motion.twist.v_m_s;
                    assert!(v * wish.v_m_s >= 0.0 && v.abs() <= wish.v_m_s.abs(), "{wish:?}: {motion:?}");
                }
            }
        }
    }

    #[test]
    fn the_turn_follows_the_speed_onto_the_wished_curve() {
        let mut motion = Motion::REST;
        for _ in 0..40 {
            motion = limiter().towards(&motion, Twist::new(0.8, 0.8), 0.01);
            assert!((motion.twist.w_rad_s - motion.twist.v_m_s).abs() < 1e-5, "{motion:?}");
        }
    }

    /// From rest to full speed, to reverse and back, by steady ticks: no change of acceleration beyond the jerk but where
    /// the sign of the speed or its limit ends a motion.
    #[test]
    fn comfort_keeps_the_jerk() {
        let l = loomo().limits;
        let mut from = Motion::REST;
        for wish in [0.9, 0.3, 0.6, 0.59, 0.1] {
            for _ in 0..35 {
                let next = limiter().towards(&from, Twist::new(wish, 0.0), 0.01);
                let jerk = (next.acceleration_m_s2 - from.acceleration_m_s2).abs() / 0.01;
                // Braking is weaker than accelerating; a speed-up may end at once to begin it.
                assert!(jerk <= l.comfort_jerk_m_s3 * 1.01 + 0.1, "{wish}: {from:?} {next:?}");
                from = next;
            }
        }
    }

    proptest! {
        #[test]
        fn no_wish_breaks_a_limit(
            wishes in prop::collection::vec((-9.0f32..9.0, -9.0f32..9.0, 0.0f32..0.02, 0u32..6), 1..200),
        ) {
            let l = loomo().limits;
            let limiter = limiter();
            let mut from = Motion::REST;
            for (v, w, dt, kind) in wishes {
                let dt = if kind == 0 { 0.0 } else { dt };
                let wish = Twist::new(v, if kind == 1 { f32::NAN } else { w });
                let next = match kind {
                    2 => limiter.brake(&from, dt, true),
                    3 => limiter.brake(&from, dt, false),
                    _ => limiter.towards(&from, wish, dt),
                };
                let (a, b) = (from.twist, next.twist);
                prop_assert!(b.v_m_s <= l.forward_m_s && b.v_m_s >= -l.reverse_m_s);
                prop_assert!(b.w_rad_s.abs() <= l.turn_rad_s);
                prop_assert!((b.w_rad_s - a.w_rad_s).abs() <= l.turn_accelerate_rad_s2 * dt + 1e-5);
                let rate = if b.v_m_s.abs() < a.v_m_s.abs() { l.brake_m_s2 } else { l.accelerate_m_s2 };
                prop_assert!((b.v_m_s - a.v_m_s).abs() <= rate * dt + 2e-4, "{a:?} {b:?} {dt}");
                from = next;
            }
        }
    }
}

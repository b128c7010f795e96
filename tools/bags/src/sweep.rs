//! Lidar sweeps of ROS, as the message `scan` has them.

use crate::messages::LaserScan;
use crate::rigid::Rigid;
use sidestep_msgs::{Pose2, SCAN_BEAMS, Scan};

/// `[1]` smallest part of the sensor's axis along the vertical: a tilt of 10 degrees.
const UPRIGHT_MIN: f64 = 0.985;
/// `[s]` no sweep takes longer.
const SWEEP_S_MAX: f64 = 1.0;

/// Fills a sweep, all but its stamp, and returns the nanoseconds from the stamp of ROS to the middle of the sweep.
///
/// A lidar that hangs upside down or turns clockwise is turned round; of more beams than there is room for, the
/// nearest of each group is taken.
pub(crate) fn fill(scan: &LaserScan, placed: &Rigid, sweep: &mut Scan) -> Result<u64, String> {
    let tip = |v: [f64; 3]| {
        let point = Rigid { translation_m: v, ..Rigid::IDENTITY };
        let there = placed.compose(&point).translation_m;
        [0, 1, 2].map(|i| there[i] - placed.translation_m[i])
    };
    let (ahead, up) = (tip([1.0, 0.0, 0.0]), tip([0.0, 0.0, 1.0]));
    if up[2].abs() < UPRIGHT_MIN {
        return Err(format!("a lidar that is tilted by {:.0} degrees", libm::acos(up[2].abs()).to_degrees()));
    }
    let sound = scan.angle_min.is_finite() && scan.angle_increment.is_finite();
    let limits = scan.range_min >= 0.0 && scan.range_max > scan.range_min && scan.range_max.is_finite();
    if scan.ranges.is_empty() || !sound || scan.angle_increment.abs() < 1e-6 || !limits {
        let (count, step) = (scan.ranges.len(), scan.angle_increment);
        return Err(format!("{count} beams every {step} rad, {} to {} m", scan.range_min, scan.range_max));
    }
    let flip = if up[2] < 0.0 { -1.0 } else { 1.0 };
    let (first, step) = (flip * scan.angle_min, flip * scan.angle_increment);
    let group = scan.ranges.len().div_ceil(SCAN_BEAMS);
    let count = scan.ranges.len() / group;
    // The middle of a group stands for it.
    let (first, step) = (first + 0.5 * step * (group as f32 - 1.0), step * group as f32);
    for (beam, ranges) in scan.ranges.chunks_exact(group).enumerate() {
        let place = if step < 0.0 { count - 1 - beam } else { beam };
        sweep.range_m[place] = nearest(ranges, scan.range_min, scan.range_max);
    }
    sweep.range_m[count..].fill(0.0);
    sweep.sensor =
        Pose2::new(placed.translation_m[0], placed.translation_m[1], libm::atan2(ahead[1], ahead[0]));
    sweep.first_rad = if step < 0.0 { first + step * (count - 1) as f32 } else { first };
    sweep.step_rad = step.abs();
    (sweep.near_m, sweep.far_m) = (scan.range_min, scan.range_max);
    sweep.height_m = placed.translation_m[2] as f32;
    sweep.count = count as u32;
    let half_s = 0.5 * f64::from(scan.time_increment) * scan.ranges.len() as f64;
    Ok(if half_s > 0.0 && half_s < SWEEP_S_MAX { (half_s * 1e9) as u64 } else { 0 })
}

/// The nearest range of a group; infinite = nothing up to the limit, NaN = no measurement (REP-117).
fn nearest(ranges: &[f32], near_m: f32, far_m: f32) -> f32 {
    let read = |&range: &f32| match range {
        nothing if nothing > far_m => f32::INFINITY,
        range if range >= near_m => range,
        _ => f32::NAN,
    };
    ranges.iter().map(read).fold(f32::NAN, f32::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lidar_upside_down_or_turning_clockwise_sees_left_at_its_left() {
        let mut sweep: Box<Scan> = bytemuck::allocation::zeroed_box();
        let scan = LaserScan {
            angle_min: -1.0,
            angle_increment: 1.0,
            range_min: 0.1,
            range_max: 10.0,
            ranges: vec![1.0, f32::INFINITY, 0.05],
            ..LaserScan::default()
        };
        let upright = Rigid { translation_m: [0.1, 0.0, 0.3], ..Rigid::IDENTITY };
        fill(&scan, &upright, &mut sweep).unwrap();
        assert_eq!((sweep.first_rad, sweep.range_m[0], sweep.range_m[1]), (-1.0, 1.0, f32::INFINITY));
        assert!(sweep.range_m[2].is_nan() && sweep.count == 3 && (sweep.height_m - 0.3).abs() < 1e-6);
        // Hanging: what was at its right is at the left of the robot.
        let hanging = Rigid { rotation_xyzw: [1.0, 0.0, 0.0, 0.0], ..upright };
        fill(&scan, &hanging, &mut sweep).unwrap();
        assert!((sweep.first_rad + 1.0).abs() < 1e-6 && sweep.range_m[0].is_nan(), "{}", sweep.first_rad);
        assert_eq!((sweep.range_m[2], sweep.sensor.yaw_rad), (1.0, 0.0));
        let tilted = Rigid { rotation_xyzw: [0.0, 0.38, 0.0, 0.925], ..upright };
        assert!(fill(&scan, &tilted, &mut sweep).unwrap_err().contains("tilted"));
    }

    #[test]
    fn of_more_beams_than_there_is_room_for_the_nearest_counts() {
        let mut sweep: Box<Scan> = bytemuck::allocation::zeroed_box();
        let mut ranges = vec![5.0; 2 * SCAN_BEAMS];
        ranges[11] = 2.0;
        let scan = LaserScan {
            angle_increment: 0.001,
            range_min: 0.1,
            range_max: 10.0,
            ranges,
            ..LaserScan::default()
        };
        fill(&scan, &Rigid::IDENTITY, &mut sweep).unwrap();
        assert_eq!((sweep.count as usize, sweep.range_m[5], sweep.range_m[6]), (SCAN_BEAMS, 2.0, 5.0));
        assert!((sweep.step_rad - 0.002).abs() < 1e-9 && (sweep.first_rad - 0.0005).abs() < 1e-9);
    }
}

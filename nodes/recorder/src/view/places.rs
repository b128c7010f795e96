//! Where things are: transforms, camera, path, beams.

use super::Seen;
use super::channels::{BEAMS, CAMERA, ROUTE, TF};
use super::file_time::{FileTime, is_due};
use super::shapes::{BASE, BODY, CAMERA_FRAME, ODOM, WORLD, pose, tilt, vector, yaw};
use super::sheet::Sheet;
use foxglove::messages::{
    CameraCalibration, FrameTransform, FrameTransforms, LaserScan, Pose, PosesInFrame, Quaternion, Timestamp,
};
use sidestep_msgs::{
    COMMAND, DEPTH, DepthFrame, Isometry, ODOMETRY, Odometry, PATH, Path, Pose2, SCAN, Scan, TRUTH, Truth,
};
use std::mem::offset_of;

/// `[ns]` graph time after which the path is shown again, for whoever joins late.
const PATH_EVERY_NS: u64 = 1_000_000_000;
/// `[ns]` graph time between two transforms from `world`; drift is slow.
const WORLD_EVERY_NS: u64 = 100_000_000;
/// `[ns]` truth and odometry this close are of one tick of the simulator.
const MOMENT_NS: u64 = 1_000_000;

/// What is remembered of places.
#[derive(Default)]
pub(crate) struct Places {
    odometry: Odometry,
    world_ns: Option<u64>,
    path: Option<PosesInFrame>,
    path_ns: Option<u64>,
}

fn transform(stamp: Option<Timestamp>, frames: [&str; 2], at: [f64; 3], turn: Quaternion) -> FrameTransform {
    FrameTransform {
        timestamp: stamp,
        parent_frame_id: frames[0].into(),
        child_frame_id: frames[1].into(),
        translation: vector(at[0], at[1], at[2]),
        rotation: Some(turn),
    }
}

/// A field of a depth frame without its pixels, which are too many to copy.
fn field<T: bytemuck::AnyBitPattern>(frame: &[u8], offset: usize) -> T {
    bytemuck::pod_read_unaligned(&frame[offset..offset + size_of::<T>()])
}

impl Places {
    pub(crate) fn take(&mut self, seen: &Seen, time: &FileTime, sheet: &mut Sheet) {
        if let Some(odometry) = seen.read(ODOMETRY) {
            self.odometry(&odometry, time, sheet);
        } else if let Some(truth) = seen.read(TRUTH) {
            self.truth(&truth, time, sheet);
        } else if let Some(path) = seen.read(PATH) {
            self.path = Some(route(&path));
            self.path_ns = None;
            self.route(seen.header.now_ns, time, sheet);
        } else if let Some(scan) = seen.read(SCAN) {
            beams(&scan, time, sheet);
        } else if seen.row.index == DEPTH.index {
            camera(seen.message, time, sheet);
        } else if seen.row.index == COMMAND.index {
            self.route(seen.header.now_ns, time, sheet);
        }
    }

    fn route(&mut self, now_ns: u64, time: &FileTime, sheet: &mut Sheet) {
        let Some(path) = &mut self.path else { return };
        if is_due(&mut self.path_ns, now_ns, PATH_EVERY_NS) {
            path.timestamp = time.stamp(now_ns);
            sheet.put(ROUTE, path);
        }
    }

    fn odometry(&mut self, odometry: &Odometry, time: &FileTime, sheet: &mut Sheet) {
        self.odometry = *odometry;
        if !(odometry.pose.is_finite() && odometry.roll_rad.is_finite() && odometry.pitch_rad.is_finite()) {
            return;
        }
        let stamp = time.stamp(odometry.stamp_ns);
        let place = [odometry.pose.x_m, odometry.pose.y_m, 0.0];
        let lean = tilt(f64::from(odometry.roll_rad), f64::from(odometry.pitch_rad));
        let transforms = vec![
            transform(stamp, [ODOM, BASE], place, yaw(odometry.pose.yaw_rad)),
            transform(stamp, [BASE, BODY], [0.0; 3], lean),
        ];
        sheet.put(TF, &FrameTransforms { transforms });
    }

    /// Odometry drifts in the world: what is true is placed in `world`, and this says where `odom` lies in it.
    fn truth(&mut self, truth: &Truth, time: &FileTime, sheet: &mut Sheet) {
        let fits = self.odometry.stamp_ns.abs_diff(truth.stamp_ns) <= MOMENT_NS
            && self.odometry.pose.is_finite()
            && truth.pose.is_finite();
        if !fits || !is_due(&mut self.world_ns, truth.stamp_ns, WORLD_EVERY_NS) {
            return;
        }
        let origin = truth.pose.compose(&self.odometry.pose.relative(&Pose2::ORIGIN));
        let place = [origin.x_m, origin.y_m, 0.0];
        let world = transform(time.stamp(truth.stamp_ns), [WORLD, ODOM], place, yaw(origin.yaw_rad));
        sheet.put(TF, &FrameTransforms { transforms: vec![world] });
    }
}

/// The points of a path, each facing the next.
fn route(path: &Path) -> PosesInFrame {
    let points = &path.points[..(path.count as usize).min(path.points.len())];
    let poses = points.iter().enumerate().map(|(index, point)| {
        let place = Pose2::new(f64::from(point.x_m), f64::from(point.y_m), 0.0);
        let ahead = points.get(index + 1).map(|next| [next.x_m - point.x_m, next.y_m - point.y_m]);
        let behind = || {
            let before = &points[index.checked_sub(1)?];
            Some([point.x_m - before.x_m, point.y_m - before.y_m])
        };
        Pose { orientation: Some(facing(ahead.or_else(behind).unwrap_or([1.0, 0.0]))), ..pose(&place, 0.0) }
    });
    PosesInFrame { timestamp: None, frame_id: ODOM.into(), poses: poses.collect() }
}

/// The turn about z from the x axis to a direction: half-angle formulas, without an arc tangent.
fn facing(direction: [f32; 2]) -> Quaternion {
    let [dx, dy] = direction.map(f64::from);
    let length = (dx * dx + dy * dy).sqrt();
    if length.is_nan() || length <= 0.0 {
        return yaw(0.0);
    }
    let cos = (dx / length).clamp(-1.0, 1.0);
    let z = (0.5 * (1.0 - cos)).sqrt().copysign(dy);
    Quaternion { x: 0.0, y: 0.0, z, w: (0.5 * (1.0 + cos)).sqrt() }
}

fn beams(scan: &Scan, time: &FileTime, sheet: &mut Sheet) {
    let count = (scan.count as usize).min(scan.range_m.len());
    let first = f64::from(scan.first_rad);
    let last = first + f64::from(scan.step_rad) * count.saturating_sub(1) as f64;
    let beams = LaserScan {
        timestamp: time.stamp(scan.capture_ns),
        frame_id: BASE.into(),
        pose: Some(pose(&scan.sensor, f64::from(scan.height_m))),
        start_angle: first,
        end_angle: last,
        ranges: scan.range_m[..count].iter().map(|&range_m| f64::from(range_m)).collect(),
        intensities: Vec::new(),
    };
    sheet.put(BEAMS, &beams);
}

fn camera(frame: &[u8], time: &FileTime, sheet: &mut Sheet) {
    let stamp = time.stamp(field(frame, offset_of!(DepthFrame, capture_ns)));
    let mount: Isometry = field(frame, offset_of!(DepthFrame, camera));
    if mount.is_valid() {
        let [x, y, z, w] = mount.rotation_xyzw.map(f64::from);
        let place = mount.translation_m.map(f64::from);
        let camera = transform(stamp, [BODY, CAMERA_FRAME], place, Quaternion { x, y, z, w });
        sheet.put(TF, &FrameTransforms { transforms: vec![camera] });
    }
    let number = |offset| f64::from(field::<f32>(frame, offset));
    let [fx, fy] = [offset_of!(DepthFrame, fx_px), offset_of!(DepthFrame, fy_px)].map(number);
    let [cx, cy] = [offset_of!(DepthFrame, cx_px), offset_of!(DepthFrame, cy_px)].map(number);
    let calibration = CameraCalibration {
        timestamp: stamp,
        frame_id: CAMERA_FRAME.into(),
        width: field(frame, offset_of!(DepthFrame, width)),
        height: field(frame, offset_of!(DepthFrame, height)),
        distortion_model: "plumb_bob".into(),
        d: vec![0.0; 5],
        k: vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    };
    sheet.put(CAMERA, &calibration);
}

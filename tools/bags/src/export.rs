//! A recording into a ROS 2 bag: what the robot saw, where it was, what it planned and what it was told.

use crate::bagfile::{BagFile, BagTotals, Output};
use crate::error::BagError;
use crate::messages as ros;
use crate::messages::{Time, Transform};
use crate::occupancy;
use crate::raster::METRES_PER_UNIT;
use crate::rigid::Rigid;
use sidestep_msgs::{
    COMMAND, DEPTH, DepthFrame, EXPERT_COMMAND, LOCAL_GRID, LOCAL_MAP, LocalMap, MONO_TO_WALL_KEY, ODOMETRY,
    ORIGIN_RECORD, Odometry, PATH, POLICY_COMMAND, Path, Pose2, SCAN, Scan, Twist,
};
use sidestep_player::{Entry, Info, Messages};
use std::collections::BTreeMap;

/// `[ns]` stamps and times of receipt that differ by no more tell the same clock.
const SAME_CLOCK_NS: u64 = 1_000_000_000;

const ODOM: &str = "odom";
const BASE: &str = "base_link";
const CAMERA: &str = "camera_optical_frame";
const LASER: &str = "laser";

const IMAGE: Output = Output::new("/camera/depth/image_rect_raw", "sensor_msgs/Image");
const CAMERA_INFO: Output = Output::new("/camera/depth/camera_info", "sensor_msgs/CameraInfo");
const SWEEP: Output = Output::new("/scan", "sensor_msgs/LaserScan");
const POSE: Output = Output::new("/odom", "nav_msgs/Odometry");
const TF: Output = Output::new("/tf", "tf2_msgs/TFMessage");
const TF_STATIC: Output = Output::latched("/tf_static", "tf2_msgs/TFMessage");
const MAP: Output = Output::new("/local_map", "nav_msgs/OccupancyGrid");
const PLAN: Output = Output::new("/plan", "nav_msgs/Path");
const TOLD: Output = Output::new("/cmd_vel", "geometry_msgs/TwistStamped");
const POLICY: Output = Output::new("/policy/cmd_vel", "geometry_msgs/TwistStamped");
const EXPERT: Output = Output::new("/expert/cmd_vel", "geometry_msgs/TwistStamped");

/// What an export made.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ExportSummary {
    /// Files, topics and messages.
    pub totals: BagTotals,
    /// Where the recording could not be read to its end.
    pub damage: Option<String>,
}

/// Where a sensor was over the whole recording.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
enum Mounting {
    #[default]
    Unseen,
    Fixed(Rigid),
    Moves,
}

impl Mounting {
    fn learn(&mut self, pose: Rigid) {
        *self = match *self {
            Self::Unseen => Self::Fixed(pose),
            Self::Fixed(same) if same == pose => Self::Fixed(same),
            _ => Self::Moves,
        };
    }
}

/// Writes the messages of a recording with the wall times of their stamps.
struct Exporter {
    file: BagFile,
    /// `[ns]` from graph time to wall time, by epoch.
    to_wall_ns: BTreeMap<u32, i64>,
    camera: Mounting,
    laser: Mounting,
    said_static: bool,
    frame: Box<DepthFrame>,
}

/// Exports a recording into a bag: a folder with `metadata.yaml`, or a single file where `out` ends in `.mcap`.
///
/// # Errors
/// [`BagError`]; nothing is overwritten.
pub fn export_bag(recording: &std::path::Path, out: &std::path::Path) -> Result<ExportSummary, BagError> {
    let info = Info::read(recording)?;
    let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
    let (mut camera, mut laser) = (Mounting::default(), Mounting::default());
    let mut to_wall_ns = BTreeMap::new();
    for entry in Messages::open(recording)? {
        let entry = entry?;
        let ahead_ns = i128::from(entry.logged_ns) - i128::from(entry.header.now_ns);
        let ahead_ns = i64::try_from(ahead_ns).unwrap_or(0);
        let least = to_wall_ns.entry(entry.header.epoch).or_insert(ahead_ns);
        // Whoever joins late gets an old path late; the promptest message tells the clocks apart.
        *least = ahead_ns.min(*least);
        if entry.read_into(DEPTH, &mut frame) {
            camera.learn(Rigid::from(&frame.camera));
        } else if let Some(scan) = entry.read(SCAN) {
            laser.learn(mounted(&scan));
        }
    }
    let origin = info.metadata.get(ORIGIN_RECORD);
    if let Some(known_ns) = origin.and_then(|origin| origin.get(MONO_TO_WALL_KEY)?.parse::<i64>().ok()) {
        let same = |measured_ns: &&mut i64| measured_ns.abs_diff(known_ns) < SAME_CLOCK_NS;
        to_wall_ns.values_mut().filter(same).for_each(|measured_ns| *measured_ns = known_ns);
    }
    let mut exporter =
        Exporter { file: BagFile::create(out)?, to_wall_ns, camera, laser, said_static: false, frame };
    let mut messages = Messages::open(recording)?;
    for entry in &mut messages {
        exporter.entry(&entry?)?;
    }
    let damage = messages.damage().map(str::to_owned).or(info.damage);
    Ok(ExportSummary { totals: exporter.file.finish()?, damage })
}

/// Pose of a lidar in base.
fn mounted(scan: &Scan) -> Rigid {
    let flat = Rigid::planar(&scan.sensor, 0.0, 0.0);
    Rigid { translation_m: [scan.sensor.x_m, scan.sensor.y_m, f64::from(scan.height_m)], ..flat }
}

impl Exporter {
    /// Stamped with the wall time of a graph time.
    fn header(&self, entry: &Entry, graph_ns: u64, frame: &str) -> ros::Header {
        let ahead_ns = self.to_wall_ns.get(&entry.header.epoch).copied().unwrap_or(0);
        let stamp = Time::from_ns(graph_ns.saturating_add_signed(ahead_ns));
        ros::Header { stamp, frame_id: frame.into() }
    }

    fn entry(&mut self, entry: &Entry) -> Result<(), BagError> {
        let logged_ns = entry.logged_ns;
        let mut frame = std::mem::replace(&mut self.frame, bytemuck::allocation::zeroed_box());
        let outcome = if entry.read_into(DEPTH, &mut frame) {
            self.depth(entry, &frame)
        } else if let Some(odometry) = entry.read(ODOMETRY) {
            self.odometry(entry, &odometry)
        } else if let Some(map) = entry.read(LOCAL_MAP) {
            let header = self.header(entry, map.capture_ns, BASE);
            self.file.send(&MAP, logged_ns, &grid(header, &map))
        } else if let Some(path) = entry.read(PATH) {
            let header = self.header(entry, entry.header.now_ns, ODOM);
            self.file.send(&PLAN, logged_ns, &plan(&header, &path))
        } else if let Some(scan) = entry.read(SCAN) {
            self.scan(entry, &scan)
        } else if let Some(command) = entry.read(COMMAND) {
            self.twist(entry, &TOLD, command.twist)
        } else if let Some(proposal) = entry.read(POLICY_COMMAND) {
            self.twist(entry, &POLICY, proposal.twist)
        } else if let Some(proposal) = entry.read(EXPERT_COMMAND) {
            self.twist(entry, &EXPERT, proposal.twist)
        } else {
            Ok(())
        };
        self.frame = frame;
        outcome
    }

    fn twist(&mut self, entry: &Entry, output: &Output, twist: Twist) -> Result<(), BagError> {
        let header = self.header(entry, entry.header.now_ns, BASE);
        self.file.send(output, entry.logged_ns, &ros::TwistStamped { header, twist: planar(twist) })
    }

    /// Says once where the sensors are that never move.
    fn fixed(&mut self, entry: &Entry, graph_ns: u64) -> Result<(), BagError> {
        if std::mem::replace(&mut self.said_static, true) {
            return Ok(());
        }
        let header = self.header(entry, graph_ns, BASE);
        let mut transforms = Vec::new();
        for (mounting, child) in [(self.camera, CAMERA), (self.laser, LASER)] {
            if let Mounting::Fixed(pose) = mounting {
                transforms.push(joint(&header, child, pose));
            }
        }
        if transforms.is_empty() {
            return Ok(());
        }
        self.file.send(&TF_STATIC, entry.logged_ns, &ros::TransformMessage { transforms })
    }

    /// Says where a sensor that moves was at this time.
    fn moved(
        &mut self,
        entry: &Entry,
        header: &ros::Header,
        child: &str,
        pose: Rigid,
    ) -> Result<(), BagError> {
        let header = ros::Header { frame_id: BASE.into(), ..header.clone() };
        let transforms = vec![joint(&header, child, pose)];
        self.file.send(&TF, entry.logged_ns, &ros::TransformMessage { transforms })
    }

    fn odometry(&mut self, entry: &Entry, odometry: &Odometry) -> Result<(), BagError> {
        self.fixed(entry, odometry.stamp_ns)?;
        let header = self.header(entry, odometry.stamp_ns, ODOM);
        let pose = Rigid::planar(&odometry.pose, odometry.roll_rad.into(), odometry.pitch_rad.into());
        let transforms = vec![joint(&header, BASE, pose)];
        self.file.send(&TF, entry.logged_ns, &ros::TransformMessage { transforms })?;
        let mut pose_covariance = ros::Covariance::default();
        for (variance, at) in odometry.variance.iter().zip([0, 1, 5]) {
            pose_covariance[at][at] = f64::from(*variance);
        }
        let message = ros::Odometry {
            header,
            child_frame_id: BASE.into(),
            pose: Transform::from(pose),
            pose_covariance,
            twist: planar(odometry.twist),
            ..ros::Odometry::default()
        };
        self.file.send(&POSE, entry.logged_ns, &message)
    }

    fn depth(&mut self, entry: &Entry, frame: &DepthFrame) -> Result<(), BagError> {
        self.fixed(entry, frame.capture_ns)?;
        let header = self.header(entry, frame.capture_ns, CAMERA);
        if self.camera == Mounting::Moves {
            self.moved(entry, &header, CAMERA, Rigid::from(&frame.camera))?;
        }
        self.file.send(&CAMERA_INFO, entry.logged_ns, &camera_info(&header, frame))?;
        let pixels = frame.used_pixels();
        let is_millimetres = (frame.metres_per_unit - METRES_PER_UNIT).abs() < 1e-9;
        // Any other unit has no name in 16UC1, which is millimetres (REP-118).
        let metres: Vec<f32>;
        let (encoding, data): (&str, &[u8]) = if is_millimetres {
            ("16UC1", bytemuck::cast_slice(pixels))
        } else {
            let metre = |&pixel: &u16| match pixel {
                0 | u16::MAX => f32::NAN,
                pixel => f32::from(pixel) * frame.metres_per_unit,
            };
            metres = pixels.iter().map(metre).collect();
            ("32FC1", bytemuck::cast_slice(&metres))
        };
        let image = ros::Image {
            header,
            height: frame.height,
            width: frame.width,
            encoding: encoding.into(),
            is_bigendian: 0,
            step: frame.width * if is_millimetres { 2 } else { 4 },
            data,
        };
        self.file.send(&IMAGE, entry.logged_ns, &image)
    }

    fn scan(&mut self, entry: &Entry, scan: &Scan) -> Result<(), BagError> {
        self.fixed(entry, scan.capture_ns)?;
        let header = self.header(entry, scan.capture_ns, LASER);
        if self.laser == Mounting::Moves {
            self.moved(entry, &header, LASER, mounted(scan))?;
        }
        let ranges = scan.range_m.get(..scan.count as usize).unwrap_or_default().to_vec();
        let message = ros::LaserScan {
            header,
            angle_min: scan.first_rad,
            angle_max: scan.first_rad + scan.step_rad * scan.count.saturating_sub(1) as f32,
            angle_increment: scan.step_rad,
            range_min: scan.near_m,
            range_max: scan.far_m,
            ranges,
            ..ros::LaserScan::default()
        };
        self.file.send(&SWEEP, entry.logged_ns, &message)
    }
}

fn planar(twist: Twist) -> ros::Twist {
    let mut message = ros::Twist::default();
    (message.linear.x, message.angular.z) = (twist.v_m_s.into(), twist.w_rad_s.into());
    message
}

fn joint(header: &ros::Header, child: &str, pose: Rigid) -> ros::TransformStamped {
    let transform = Transform::from(pose);
    ros::TransformStamped { header: header.clone(), child_frame_id: child.into(), transform }
}

fn grid(header: ros::Header, map: &LocalMap) -> ros::OccupancyGrid {
    let info = occupancy::metadata(&LOCAL_GRID, header.stamp);
    ros::OccupancyGrid { header, info, data: occupancy::cells(&LOCAL_GRID, &map.occupancy, &map.age) }
}

fn plan(header: &ros::Header, path: &Path) -> ros::Path {
    let points = path.points.get(..path.count as usize).unwrap_or_default();
    let poses = points.iter().map(|point| {
        let pose = Pose2::new(point.x_m.into(), point.y_m.into(), 0.0);
        ros::PoseStamped { header: header.clone(), pose: Transform::from(Rigid::planar(&pose, 0.0, 0.0)) }
    });
    ros::Path { header: header.clone(), poses: poses.collect() }
}

fn camera_info(header: &ros::Header, frame: &DepthFrame) -> ros::CameraInfo {
    let [fx, fy, cx, cy] = [frame.fx_px, frame.fy_px, frame.cx_px, frame.cy_px].map(f64::from);
    ros::CameraInfo {
        header: header.clone(),
        height: frame.height,
        width: frame.width,
        distortion_model: "plumb_bob".into(),
        d: vec![0.0; 5],
        k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        ..ros::CameraInfo::default()
    }
}

//! Promises of the view.

use super::*;
use foxglove::Decode;
use foxglove::messages::{FrameTransforms, Grid, Log, PosesInFrame, SceneUpdate, log::Level};
use sidestep_msgs::{
    Command, LocalMap, Message, Odometry, Path, PathPoint, Pose2, Proposal, Reason, SafetyMap, Status, Topic,
    TopicVisitor, Truth, Twist, Winner, health_topic, visit_topics,
};
use std::convert::Infallible;

fn view() -> View {
    let fan: Fan = Arc::new(|_| vec![vec![[0.0, 0.0], [1.0, 0.5]]]);
    let footprint_m = vec![[0.2, -0.3], [0.2, 0.3], [-0.2, 0.3], [-0.2, -0.3]];
    View::new(&ViewSettings { shown: true, footprint_m, fan: Some(fan) }, 1_000_000_000)
}

fn show<M: Message>(
    view: &mut View,
    topic: Topic<M>,
    message: &M,
    now_ns: u64,
) -> Vec<(&'static str, Vec<u8>)> {
    let header = Header { now_ns, ..Header::default() };
    let record = [bytemuck::bytes_of(&header), bytemuck::bytes_of(message)].concat();
    view.show(topic.row(), &record, now_ns).map(|(channel, bytes)| (channel.name, bytes.to_vec())).collect()
}

fn find<M: Decode>(shown: &[(&str, Vec<u8>)], name: &str) -> M {
    let (_, bytes) = shown.iter().find(|(channel, _)| *channel == name).unwrap();
    M::decode(bytes.as_slice()).ok().unwrap()
}

#[test]
fn the_index_of_a_channel_is_its_position_and_names_are_unique() {
    for (position, channel) in VIEW_CHANNELS.iter().enumerate() {
        assert_eq!(channel.index, position, "{}", channel.name);
        assert_eq!(VIEW_CHANNELS.iter().filter(|other| other.name == channel.name).count(), 1);
        assert!(!channel.schema().data.is_empty() && channel.schema().encoding == "protobuf");
    }
}

/// Every heartbeat of the topic table, shown: the channel has the node's name.
#[test]
fn every_node_has_a_channel_for_its_health() {
    for row in TOPICS {
        let Some(topic) = row.name.strip_prefix("health/").and_then(health_topic) else { continue };
        let shown = show(&mut view(), topic, &bytemuck::Zeroable::zeroed(), 5);
        assert!(shown.iter().any(|(name, _)| *name == format!("/view/{}", row.name)), "{}", row.name);
    }
}

struct Zeros;

impl TopicVisitor for Zeros {
    type Error = Infallible;

    fn visit<M: Message>(&mut self, topic: Topic<M>) -> Result<(), Infallible> {
        let zero: Box<M> = bytemuck::allocation::zeroed_box();
        // The clock speaks through later messages.
        let silent = topic.index == CLOCK.index;
        let shows = !show(&mut view(), topic, &*zero, 1).is_empty();
        assert!(silent || shows == View::reads(topic.row()), "{}", topic.row().name);
        Ok(())
    }
}

#[test]
fn a_view_reads_exactly_the_topics_that_it_shows() {
    assert!(visit_topics(&mut Zeros).is_ok());
}

struct Noise(u64);

impl TopicVisitor for Noise {
    type Error = Infallible;

    fn visit<M: Message>(&mut self, topic: Topic<M>) -> Result<(), Infallible> {
        let mut view = view();
        for _ in 0..20 {
            let record: Vec<u8> = (0..size_of::<Header>() + topic.row().size)
                .map(|_| {
                    self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                    (self.0 >> 56) as u8
                })
                .collect();
            view.show(topic.row(), &record, self.0).count();
            assert_eq!(view.show(topic.row(), &record[1..], self.0).count(), 0);
        }
        Ok(())
    }
}

#[test]
fn no_bytes_of_any_topic_make_a_view_panic() {
    assert!(visit_topics(&mut Noise(1)).is_ok());
}

/// A cell of the safety map, found by its place in `odom`.
#[test]
fn the_safety_grid_lies_in_odom_where_the_map_says() {
    let (cell, frame) = (1234, Pose2::new(7.35, -2.1, 0.0));
    let mut map = SafetyMap { base: Pose2::new(7.36, -2.09, 1.0), ..SafetyMap::default() };
    map.still[cell] = 9;
    let grid: Grid = find(&show(&mut view(), SAFETY_MAP, &map, 5), "/view/safety_map");
    assert_eq!(grid.frame_id, "odom");
    let (corner, size) = (grid.pose.unwrap().position.unwrap(), grid.cell_size.unwrap());
    let (x_m, y_m) = sidestep_msgs::SAFETY_GRID.centre(cell / 80, cell % 80);
    let (x_m, y_m) = frame.transform(x_m.into(), y_m.into());
    let place = ((y_m - corner.y) / size.y) as usize * grid.row_stride as usize
        + ((x_m - corner.x) / size.x) as usize * grid.cell_stride as usize;
    assert_eq!(grid.fields[2].name, "still");
    assert_eq!(grid.data[place + 2], 9);
}

/// Every cell of a map without any symmetry, looked up by its centre in the grid as a viewer does.
#[test]
fn a_grid_has_each_cell_where_the_map_has_it() {
    let map = LocalMap {
        occupancy: std::array::from_fn(|index| (index * 7 % 251) as u8),
        age: std::array::from_fn(|index| (index % 256) as u8),
        ..LocalMap::default()
    };
    let grid: Grid = find(&show(&mut view(), LOCAL_MAP, &map, 5), "/view/local_map");
    let (corner, size) = (grid.pose.unwrap().position.unwrap(), grid.cell_size.unwrap());
    let names: Vec<_> = grid.fields.iter().map(|field| (field.name.as_str(), field.offset)).collect();
    assert_eq!(names, [("occupancy", 0), ("planning_cost", 1), ("age", 2)]);
    for index in 0..map.occupancy.len() {
        let (x_m, y_m) = sidestep_msgs::LOCAL_GRID.centre(index / 28, index % 28);
        let column = ((f64::from(x_m) - corner.x) / size.x) as usize;
        let row = ((f64::from(y_m) - corner.y) / size.y) as usize;
        let cell = row * grid.row_stride as usize + column * grid.cell_stride as usize;
        assert_eq!((grid.data[cell], grid.data[cell + 2]), (map.occupancy[index], map.age[index]), "{index}");
    }
    assert_eq!(grid.timestamp.unwrap().sec(), 1, "capture at graph time 0, one second later by the wall");
}

/// A point through the quaternions of the transforms, child to parent.
fn turned(transforms: &FrameTransforms, mut p: [f64; 3], chain: &[(&str, &str)]) -> [f64; 3] {
    for (parent, child) in chain {
        let found = transforms
            .transforms
            .iter()
            .find(|one| (one.parent_frame_id.as_str(), one.child_frame_id.as_str()) == (*parent, *child));
        let (t, q) = (found.unwrap().translation.unwrap(), found.unwrap().rotation.unwrap());
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let u = [q.x, q.y, q.z];
        let first = cross(u, p);
        let second = cross(u, [0, 1, 2].map(|i| first[i] + q.w * p[i]));
        let at = [t.x, t.y, t.z];
        p = [0, 1, 2].map(|i| p[i] + 2.0 * second[i] + at[i]);
    }
    p
}

#[test]
fn transforms_place_what_the_camera_sees() {
    let mut view = view();
    let pose = Pose2::new(2.0, 3.0, std::f64::consts::FRAC_PI_2);
    let odometry = Odometry { pose, pitch_rad: 0.1, roll_rad: 0.05, ..Odometry::default() };
    let mut all: FrameTransforms = find(&show(&mut view, ODOMETRY, &odometry, 5), "/view/tf");
    let mut frame: Box<sidestep_msgs::DepthFrame> = bytemuck::allocation::zeroed_box();
    frame.camera = sidestep_msgs::Isometry::camera(0.1, 0.0, 0.5, 0.0);
    let camera: FrameTransforms = find(&show(&mut view, DEPTH, &*frame, 5), "/view/tf");
    all.transforms.extend(camera.transforms);
    let ahead = turned(&all, [0.0, 0.0, 2.0], &[("body", "camera")]);
    assert!((ahead[0] - 2.1).abs() < 1e-6 && (ahead[2] - 0.5).abs() < 1e-6, "{ahead:?}");
    // Nose down: what lies ahead sinks. Right side down: what lies left rises.
    let (dip, rise) = (
        turned(&all, [1.0, 0.0, 0.0], &[("base", "body")]),
        turned(&all, [0.0, 1.0, 0.0], &[("base", "body")]),
    );
    assert!((dip[2] + libm_sin(0.1)).abs() < 1e-6 && dip[0] > 0.99, "{dip:?}");
    assert!((rise[2] - libm_sin(0.05) * (1.0 - libm_sin(0.1).powi(2)).sqrt()).abs() < 1e-6, "{rise:?}");
    let odom = turned(&all, [1.0, 0.0, 0.0], &[("odom", "base")]);
    assert!((odom[0] - 2.0).abs() < 1e-6 && (odom[1] - 4.0).abs() < 1e-6, "{odom:?}");
}

fn libm_sin(angle_rad: f64) -> f64 {
    shapes::cos_sin(angle_rad).1
}

/// The world's transform undoes the drift of odometry.
#[test]
fn what_is_true_meets_what_is_believed_in_the_world() {
    let mut view = view();
    let (believed, real) = (Pose2::new(1.0, 0.5, 0.3), Pose2::new(4.0, -2.0, 1.1));
    let odometry = show(&mut view, ODOMETRY, &Odometry { pose: believed, ..Odometry::default() }, 5);
    let truth = show(&mut view, TRUTH, &Truth { pose: real, people_count: 99, ..Truth::default() }, 5);
    let mut all: FrameTransforms = find(&odometry, "/view/tf");
    all.transforms.extend(find::<FrameTransforms>(&truth, "/view/tf").transforms);
    let nose = turned(&all, [1.0, 0.0, 0.0], &[("odom", "base"), ("world", "odom")]);
    let (x_m, y_m) = real.transform(1.0, 0.0);
    assert!((nose[0] - x_m).abs() < 1e-9 && (nose[1] - y_m).abs() < 1e-9, "{nose:?}");
    let people: SceneUpdate = find(&truth, "/view/truth");
    assert_eq!(people.entities[0].cylinders.len(), 16, "a count beyond the array shows the array");
}

#[test]
fn a_policy_without_poses_is_rolled_out_along_its_velocity() {
    let half_turn = Twist::new(0.5, std::f32::consts::PI / 2.4);
    let proposal = Proposal { twist: half_turn, ..Proposal::default() };
    let plan: SceneUpdate = find(&show(&mut view(), POLICY_COMMAND, &proposal, 5), "/view/policy/plan");
    let points = &plan.entities[0].lines[0].points;
    // Half a circle to the left of radius v / w ends beside the robot.
    let end = points.last().unwrap();
    let across_m = 2.0 * 0.5 / f64::from(half_turn.w_rad_s);
    assert!(end.x.abs() < 1e-6 && (end.y - across_m).abs() < 1e-6 && points.len() == 25, "{end:?}");
    let arrows = &plan.entities[0].arrows;
    assert_eq!(arrows.len(), 2);
    assert!((arrows[0].shaft_length + arrows[0].head_length - 0.5).abs() < 1e-6);
}

#[test]
fn a_path_faces_along_itself_and_is_shown_again_each_second() {
    let mut view = view();
    let mut path: Box<Path> = bytemuck::allocation::zeroed_box();
    path.count = 3;
    for (point, (x_m, y_m)) in path.points.iter_mut().zip([(0.0, 0.0), (0.0, -1.0), (-1.0, -1.0)]) {
        *point = PathPoint { x_m, y_m };
    }
    let mut count = 0;
    for tick in 1..=300 {
        let shown = match tick {
            1 => show(&mut view, PATH, &*path, 10_000_000),
            _ => show(&mut view, COMMAND, &Command::default(), tick * 10_000_000),
        };
        if shown.iter().any(|(name, _)| *name == "/view/path") {
            count += 1;
            let poses: PosesInFrame = find(&shown, "/view/path");
            let turns: Vec<_> = poses.poses.iter().map(|pose| pose.orientation.unwrap()).collect();
            // South, then west, and the last as the one before it.
            let half = 0.5_f64.sqrt();
            assert!((turns[0].z + half).abs() < 1e-9 && (turns[0].w - half).abs() < 1e-9, "{turns:?}");
            assert!((turns[1].z.abs() - 1.0).abs() < 1e-9 && turns[1] == turns[2], "{turns:?}");
        }
    }
    assert_eq!(count, 3);
}

#[test]
fn the_log_speaks_when_a_reason_changes_and_not_before() {
    let mut view = view();
    let reasons =
        [Reason::Clear, Reason::Clear, Reason::Slowed, Reason::Emergency, Reason::Emergency, Reason::Clear];
    let mut lines = Vec::new();
    for (tick, reason) in reasons.into_iter().enumerate() {
        let command = Command { reason: reason as u32, winner: Winner::Policy as u32, ..Command::default() };
        let shown = show(&mut view, COMMAND, &command, tick as u64);
        if shown.iter().any(|(name, _)| *name == "/view/log") {
            let line: Log = find(&shown, "/view/log");
            lines.push((line.level, line.message));
        }
    }
    let levels: Vec<_> = lines.iter().map(|(level, _)| *level).collect();
    assert_eq!(levels, [Level::Info, Level::Info, Level::Error, Level::Info].map(|level| level as i32));
    assert!(lines[2].1.contains("inside the braking distance") && lines[2].1.contains("policy"), "{lines:?}");
}

#[test]
fn a_node_that_refuses_or_comes_back_is_in_the_log() {
    let mut view = view();
    let mut lines = Vec::new();
    for (status, incarnation) in
        [(Status::Ok, 0), (Status::RefusedEmpty, 0), (Status::Ok, 0), (Status::Ok, 1)]
    {
        let header = Header { status: status as u32, incarnation, ..Header::default() };
        let record = [bytemuck::bytes_of(&header), bytemuck::bytes_of(&LocalMap::default())].concat();
        let shown = view.show(LOCAL_MAP.row(), &record, 1);
        let shown: Vec<_> = shown.map(|(channel, bytes)| (channel.name, bytes.to_vec())).collect();
        if shown.iter().any(|(name, _)| *name == "/view/log") {
            lines.push(find::<Log>(&shown, "/view/log"));
        }
    }
    let said: Vec<_> = lines.iter().map(|line| (line.name.as_str(), line.level)).collect();
    assert_eq!(said, [("mapper", 2), ("mapper", 3), ("mapper", 2), ("mapper", 2)]);
}

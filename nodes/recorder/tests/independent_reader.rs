//! A recording through the real writer, read by a reader that knows nothing of this project.
#![allow(
    clippy::unwrap_used,
    clippy::float_cmp,
    missing_docs,
    reason = "a test says what it expects by failing"
)]

use serde_json::{Value, json};
use sidestep_msgs::{
    CLOCK, COMMAND, Clock, Command, DEPTH, DepthFrame, EXPERT_COMMAND, HEALTH_MAPPER, Header, Health,
    Isometry, LOCAL_GOAL, LOCAL_GRID, LOCAL_MAP, LocalGoal, LocalMap, Message, ODOMETRY, Odometry, PATH,
    POLICY_COMMAND, Path, Pose2, Proposal, Reason, SAFETY_MAP, SCAN, SafetyMap, Scan, Stage, StageStamp,
    TOPICS, TRUTH, Topic, Truth, Twist, Winner, health_topic,
};
use sidestep_recorder::{Origin, VIEW_CHANNELS, ViewSettings, Writer};
use std::fs::File;
use std::process::Command as Process;
use std::sync::Arc;

const WALL_NS: i64 = 1_700_000_000_000_000_000;
/// `[ns]` from capture to receipt.
const LATE_NS: u64 = 2_000_000;
const FRAMES: u64 = 30;

struct Tape(Writer<File>, u64);

impl Tape {
    fn write<M: Message>(&mut self, topic: Topic<M>, message: &M, now_ns: u64, answered: u64) {
        self.1 += 1;
        let mut header = Header { now_ns, sequence: self.1, source_frame: answered, ..Header::default() };
        header.stages[Stage::Depth as usize] = StageStamp { receive_ns: now_ns, send_ns: now_ns };
        header.stages[Stage::Arbiter as usize] =
            StageStamp { receive_ns: now_ns, send_ns: now_ns + 1_500_000 };
        self.0.write(topic.row(), &header, bytemuck::bytes_of(message), now_ns + LATE_NS).unwrap();
    }
}

fn settings() -> ViewSettings {
    ViewSettings {
        shown: true,
        footprint_m: vec![[0.2, -0.3], [0.2, 0.3], [-0.2, 0.0]],
        fan: Some(Arc::new(|_| vec![vec![[0.0, 0.0], [0.5, 0.1], [1.0, 0.4]]; 100])),
    }
}

/// A second of every topic that shows something; one cell of the map is occupied, ahead and to the left.
fn record(path: &std::path::Path) {
    let origin = Origin { mono_to_wall_ns: WALL_NS, view: settings(), ..Origin::default() };
    let mut tape = Tape(Writer::new(File::create(path).unwrap(), "test", &origin).unwrap(), 0);
    let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
    (frame.width, frame.height, frame.fx_px, frame.fy_px) = (64, 48, 50.0, 51.0);
    (frame.cx_px, frame.cy_px) = (31.5, 23.5);
    frame.camera = Isometry::camera(0.1, 0.0, 0.5, 0.2);
    let mut path: Box<Path> = bytemuck::allocation::zeroed_box();
    path.count = 20;
    let mut map = LocalMap::default();
    map.occupancy[LOCAL_GRID.index(1.55, 0.35).unwrap()] = 255;
    tape.write(CLOCK, &Clock::default(), 0, 0);
    tape.write(PATH, &*path, 0, 0);
    for number in 1..=FRAMES {
        let now_ns = number * 33_000_000;
        let pose = Pose2::new(number as f64 * 0.01, 0.0, 0.1);
        tape.write(ODOMETRY, &Odometry { stamp_ns: now_ns, pose, ..Odometry::default() }, now_ns, 0);
        tape.write(TRUTH, &Truth { stamp_ns: now_ns, people_count: 2, ..Truth::default() }, now_ns, 0);
        frame.capture_ns = now_ns;
        tape.write(DEPTH, &*frame, now_ns, number);
        let scan = Scan { capture_ns: now_ns, count: 360, ..Scan::default() };
        tape.write(SCAN, &scan, now_ns, number);
        map.capture_ns = now_ns;
        tape.write(LOCAL_MAP, &map, now_ns, number);
        tape.write(SAFETY_MAP, &SafetyMap { capture_ns: now_ns, ..SafetyMap::default() }, now_ns, number);
        let goal = LocalGoal { capture_ns: now_ns, x_m: 2.0, y_m: 0.5, ..LocalGoal::default() };
        tape.write(LOCAL_GOAL, &goal, now_ns, number);
        let twist = Twist::new(0.5, -0.25);
        let proposal = Proposal { capture_ns: now_ns, twist, trajectory_count: 24, ..Proposal::default() };
        tape.write(POLICY_COMMAND, &Proposal { trajectory_count: 0, ..proposal }, now_ns, number);
        tape.write(EXPERT_COMMAND, &proposal, now_ns, number);
        let reason = if number == FRAMES { Reason::Emergency } else { Reason::Clear } as u32;
        let command =
            Command { twist, reason, winner: Winner::Policy as u32, answers: 1, ..Command::default() };
        tape.write(COMMAND, &command, now_ns, number);
        tape.write(HEALTH_MAPPER, &Health::default(), now_ns, 0);
    }
    for row in TOPICS {
        if let Some(topic) = row.name.strip_prefix("health/").and_then(health_topic) {
            tape.write(topic, &Health::default(), FRAMES * 33_000_000, 0);
        }
    }
    tape.0.finish(&[]).unwrap();
}

fn check(read: &Value) {
    let (counts, found) = (&read["counts"], &read["found"]);
    for channel in VIEW_CHANNELS {
        assert!(counts[channel.name].as_u64().unwrap_or(0) > 0, "{}: {counts:#}", channel.name);
        assert_eq!(read["schemas"][channel.name], channel.schema().name, "{}", channel.name);
    }
    for name in
        ["depth", "/view/local_map", "/view/command", "/view/expert/plan", "/view/scan", "/view/latency"]
    {
        assert_eq!(counts[name], FRAMES, "{name}");
        // Stamps are capture times on the clock of the file.
        assert_eq!(read["late"][name].as_u64().unwrap_or(LATE_NS), LATE_NS, "{name}");
    }
    assert_eq!(counts["/view/expert/candidates"], FRAMES / 5);
    assert_eq!(found["occupied"], json!([[1.55, 0.35]]));
    assert_eq!(found["frames"], json!(["base>body", "body>camera", "odom>base", "world>odom"]));
    let driven = Reason::Emergency;
    let label = sidestep_msgs::Code::label(driven);
    assert_eq!(found["command"], json!([0.5, -0.25, label, "policy", FRAMES]));
    assert_eq!(found["latency"], 1.5);
    assert_eq!(found["camera"], json!([64, 48, 50.0, 0.0, 31.5, 0.0, 51.0, 23.5, 0.0, 0.0, 1.0]));
    assert_eq!(found["image"], json!([64, 48, "16UC1", 2 * 64 * 48]));
    let log = found["log"].as_array().unwrap();
    assert!(log.iter().any(|line| line[0] == 4 && line[1] == "arbiter"), "{log:?}");
}

#[test]
fn an_independent_reader_decodes_every_view_message() {
    let python = std::env::var("SIDESTEP_PYTHON").unwrap_or("python3".into());
    let ready = Process::new(&python).args(["-c", "import mcap.reader, mcap_protobuf.decoder"]).output();
    if !ready.is_ok_and(|output| output.status.success()) {
        println!(
            "skipped: {python} has no mcap and mcap-protobuf-support (pip install mcap mcap-protobuf-support)"
        );
        return;
    }
    let path = std::env::temp_dir().join(format!("sidestep-view-{}.mcap", std::process::id()));
    record(&path);
    let script = include_str!("read_view.py");
    let output = Process::new(&python).args(["-c", script]).arg(&path).output().unwrap();
    std::fs::remove_file(&path).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let read: Value = serde_json::from_slice(&output.stdout).unwrap();
    println!("decoded: {}", read["counts"]);
    check(&read);
}

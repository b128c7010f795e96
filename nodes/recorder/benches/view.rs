//! One second of a drive at 640 x 480 and 30 Hz through the writer, with and without view channels, and the bytes of both.
//! The difference is what viewers cost.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    missing_docs,
    reason = "a bench fails by panicking and prints"
)]

use divan::Bencher;
use sidestep_msgs::{
    COMMAND, Command, DEPTH, DepthFrame, EXPERT_COMMAND, HEALTH_ARBITER, Header, Health, Isometry,
    LOCAL_GOAL, LOCAL_MAP, LocalGoal, LocalMap, Message, ODOMETRY, Odometry, POLICY_COMMAND, Pose2, Proposal,
    SAFETY_MAP, SafetyMap, TRUTH, Topic, TopicRow, Truth, Twist,
};
use sidestep_recorder::{Origin, View, ViewSettings, Writer};
use std::sync::Arc;

type Record = (&'static TopicRow, u64, Vec<u8>);

fn push<M: Message>(records: &mut Vec<Record>, topic: Topic<M>, now_ns: u64, message: &M) {
    let header = Header { now_ns, sequence: records.len() as u64, ..Header::default() };
    records.push((topic.row(), now_ns, [bytemuck::bytes_of(&header), bytemuck::bytes_of(message)].concat()));
}

/// One frame and what the nodes make of it.
fn look(records: &mut Vec<Record>, frame: &mut DepthFrame, tick: u64, now_ns: u64, twist: Twist) {
    let turn = twist.w_rad_s;
    (frame.capture_ns, frame.metres_per_unit) = (now_ns, 0.001);
    for (index, pixel) in frame.pixels.iter_mut().enumerate() {
        let noise = (index as u64 ^ tick).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 61;
        *pixel = (800 + index / 640 * 5 + noise as usize) as u16;
    }
    push(records, DEPTH, now_ns, frame);
    let wave = |index: usize| ((index as u64 * 37 + tick) % 97 / 90 * 255) as u8;
    let map = LocalMap {
        capture_ns: now_ns,
        occupancy: std::array::from_fn(wave),
        planning_cost: std::array::from_fn(|index| (index % 28 * 9) as u8),
        age: std::array::from_fn(|index| (index / 28) as u8),
        ..LocalMap::default()
    };
    push(records, LOCAL_MAP, now_ns, &map);
    let map = SafetyMap {
        capture_ns: now_ns,
        occupancy: std::array::from_fn(wave),
        age: std::array::from_fn(|index| (index / 160) as u8),
        ..SafetyMap::default()
    };
    push(records, SAFETY_MAP, now_ns, &map);
    let goal = LocalGoal { capture_ns: now_ns, twist, x_m: 2.0, ..LocalGoal::default() };
    push(records, LOCAL_GOAL, now_ns, &goal);
    let proposal = Proposal { capture_ns: now_ns, twist, ..Proposal::default() };
    push(records, POLICY_COMMAND, now_ns, &proposal);
    let wave = |index: usize| index as f32 * 0.05 + turn;
    let trajectory = Proposal {
        trajectory_count: 24,
        trajectory_x_m: std::array::from_fn(wave),
        trajectory_y_m: std::array::from_fn(wave),
        ..proposal
    };
    push(records, EXPERT_COMMAND, now_ns, &trajectory);
}

/// Every record of a second, at the rates of the topic table; maps and images with structure, not noise.
fn second() -> Vec<Record> {
    let mut records = Vec::new();
    let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
    (frame.width, frame.height, frame.fx_px, frame.fy_px) = (640, 480, 420.0, 420.0);
    frame.camera = Isometry::camera(0.1, 0.0, 0.6, 0.2);
    for tick in 0..130_u64 {
        let now_ns = 1 + tick * 7_692_307;
        let turn = tick as f32 * 0.01;
        let twist = Twist::new(0.5 + 0.1 * turn, turn);
        let pose = Pose2::new(f64::from(turn), f64::from(turn) * 0.3, f64::from(turn));
        if tick % 13 < 10 {
            push(
                &mut records,
                ODOMETRY,
                now_ns,
                &Odometry { stamp_ns: now_ns, pose, twist, ..Odometry::default() },
            );
            push(
                &mut records,
                TRUTH,
                now_ns,
                &Truth { stamp_ns: now_ns, pose, people_count: 2, ..Truth::default() },
            );
        }
        if tick % 13 % 4 == 0 && tick % 13 < 12 {
            look(&mut records, &mut frame, tick, now_ns, twist);
        }
        let answers = u32::from(tick % 13 % 4 == 0);
        push(&mut records, COMMAND, now_ns, &Command { twist, wish: twist, answers, ..Command::default() });
        for _ in 0..2 {
            // Seven nodes at 40 Hz: about two heartbeats per tick.
            push(&mut records, HEALTH_ARBITER, now_ns, &Health { cycles: tick, ..Health::default() });
        }
    }
    records
}

/// A fan as large as the launcher's: 148 curves of 7 points.
fn settings(shown: bool) -> ViewSettings {
    let curve = |index: usize| (0..7).map(|step| [step as f32 * 0.3, (step * index) as f32 * 0.01]).collect();
    ViewSettings {
        shown,
        footprint_m: vec![[0.14, -0.285], [0.14, 0.285], [-0.14, 0.285], [-0.14, -0.285]],
        fan: Some(Arc::new(move |_| (0..148).map(curve).collect())),
    }
}

fn written(records: &[Record], shown: bool) -> usize {
    let origin = Origin { flush_period_ns: 500_000_000, view: settings(shown), ..Origin::default() };
    let mut writer = Writer::new(Vec::with_capacity(32 << 20), "bench", &origin).unwrap();
    for (row, now_ns, record) in records {
        writer.write_record(row, record, *now_ns).unwrap();
    }
    writer.finish(&[]).unwrap().len()
}

#[divan::bench(args = [false, true], sample_count = 20)]
fn writer(bencher: Bencher, shown: bool) {
    let records = second();
    bencher.bench_local(|| written(&records, shown));
}

#[divan::bench(sample_count = 50)]
fn view_alone(bencher: Bencher) {
    let records = second();
    bencher.with_inputs(|| View::new(&settings(true), 0)).bench_local_values(|mut view| {
        records.iter().map(|(row, now_ns, record)| view.show(row, record, *now_ns).count()).sum::<usize>()
    });
}

fn main() {
    let records = second();
    let [without, with] = [false, true].map(|shown| written(&records, shown));
    println!("one second: {} records, {without} bytes, with view channels {with} bytes", records.len());
    divan::main();
}

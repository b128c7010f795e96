//! Recordings made up frame by frame, so that every figure is known beforehand.

use sidestep_expert::{Config, Expert};
use sidestep_msgs::{
    COMMAND, Code, Command, EXPERT_COMMAND, Header, LOCAL_CELLS, LOCAL_GOAL, LOCAL_GRID, LOCAL_MAP,
    LOCAL_SIDE, LocalGoal, LocalMap, Message, POLICY_COMMAND, Pose2, Proposal, Reason, Robot, Status, TRUTH,
    Topic, Truth, Twist, Winner, clamp_to_window,
};
use sidestep_recorder::{Origin, Writer};
use std::path::PathBuf;

pub(crate) const PERIOD_NS: u64 = 33_333_333;
const ROBOT: &str = include_str!("../../../launch/robots/loomo.toml");

/// A folder that goes when the test ends.
pub(crate) struct Folder(pub(crate) PathBuf);

impl Folder {
    pub(crate) fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("sidestep-compare-{}-{name}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

pub(crate) fn robot() -> Robot {
    Robot::from_toml("loomo.toml", ROBOT).unwrap()
}

/// What a made-up drive is like.
pub(crate) struct Drive {
    /// Frames, numbered from 1.
    pub(crate) frames: u64,
    /// Frames that never came.
    pub(crate) missing: std::ops::Range<u64>,
    /// The policy's wish relative to the expert's, by frame.
    pub(crate) offset: fn(u64) -> Twist,
    /// Whether policy and expert run.
    pub(crate) runs: [bool; 2],
    /// Status of the goal, by frame.
    pub(crate) status: fn(u64) -> Status,
    /// Moves the obstacle: two drives of equal numbers saw the same things.
    pub(crate) world: usize,
    /// Whether the robot file is within.
    pub(crate) robot: bool,
}

impl Drive {
    pub(crate) const PLAIN: Self = Self {
        frames: 120,
        missing: 0..0,
        offset: |_| Twist::STOP,
        runs: [true; 2],
        status: |_| Status::Ok,
        world: 0,
        robot: true,
    };

    /// What both see in a frame.
    pub(crate) fn seen(&self, number: u64) -> (LocalMap, LocalGoal) {
        let capture_ns = number * PERIOD_NS;
        let ahead = 6 + (number as usize / 8 + self.world) % 12;
        let block = |index: usize| {
            let (row, col) = (index / LOCAL_SIDE, index % LOCAL_SIDE);
            row.abs_diff(ahead) < 3 && col.abs_diff(15) < 4
        };
        let cost: [u8; LOCAL_CELLS] = std::array::from_fn(|index| if block(index) { 230 } else { 5 });
        let pose = Pose2::new(number as f64 * 0.02, 0.0, 0.0);
        let mut map =
            LocalMap { capture_ns, pose, planning_cost: cost, occupancy: cost, ..LocalMap::default() };
        map.age[0] = 255;
        let (x_m, y_m) = LOCAL_GRID.centre(2, 12);
        let goal = LocalGoal {
            capture_ns,
            twist: Twist::new(0.5, 0.1),
            x_m: x_m + 3.0,
            y_m,
            cell_x_m: x_m,
            cell_y_m: y_m,
            cell: (2 * LOCAL_SIDE + 12) as u32,
            ..LocalGoal::default()
        };
        (map, goal)
    }

    /// The recording, as a file's bytes.
    pub(crate) fn record(&self) -> Vec<u8> {
        let mut attachments = vec![("graph.toml".into(), b"lead = \"policy\"\n".to_vec())];
        if self.robot {
            attachments.push(("robot.toml".into(), ROBOT.as_bytes().to_vec()));
        }
        let origin = Origin { attachments, flush_period_ns: 500_000_000, ..Origin::default() };
        let mut tape = Tape { writer: Writer::new(Vec::new(), "memory", &origin).unwrap(), sequence: 0 };
        let robot = robot();
        let mut expert = Expert::new(&Config::STANDARD, &robot).unwrap();
        for number in (1..=self.frames).filter(|number| !self.missing.contains(number)) {
            let (map, goal) = self.seen(number);
            let status = (self.status)(number);
            let mut proposal = Proposal::default();
            let expert_status = expert.plan(&map, &goal, status, None, &mut proposal);
            let offset = (self.offset)(number);
            let wish =
                Twist::new(proposal.twist.v_m_s + offset.v_m_s, proposal.twist.w_rad_s + offset.w_rad_s);
            let policy = Proposal {
                twist: clamp_to_window(wish, goal.twist, &robot.limits),
                doubt_v_m_s: offset.v_m_s.abs() + 0.01,
                doubt_w_rad_s: offset.w_rad_s.abs() + 0.01,
                cost: f32::NAN,
                trajectory_count: 0,
                ..proposal
            };
            tape.say(LOCAL_MAP, number, Status::Ok, &map);
            tape.say(LOCAL_GOAL, number, status, &goal);
            if self.runs[1] {
                tape.say(EXPERT_COMMAND, number, expert_status, &proposal);
            }
            if self.runs[0] {
                tape.say(POLICY_COMMAND, number, expert_status, &policy);
            }
            let (winner, reason) = if number % 40 < 30 {
                (Winner::Policy, Reason::Clear)
            } else {
                (Winner::Stop, Reason::Emergency)
            };
            let command = Command {
                twist: policy.twist,
                winner: winner.code(),
                reason: reason.code(),
                policy_age_s: 0.01,
                answers: 1,
                ..Command::default()
            };
            tape.say(COMMAND, number, Status::Ok, &command);
            tape.say(TRUTH, number, Status::Ok, &Truth { arrivals: 2, collisions: 1, ..Truth::default() });
        }
        tape.writer.finish(&[]).unwrap()
    }
}

struct Tape {
    writer: Writer<Vec<u8>>,
    sequence: u64,
}

impl Tape {
    fn say<M: Message>(&mut self, topic: Topic<M>, number: u64, status: Status, message: &M) {
        self.sequence += 1;
        let now_ns = number * PERIOD_NS + 2_000_000;
        let header = Header {
            run: 0x1234_5678_9abc,
            sequence: self.sequence,
            source_frame: number,
            now_ns,
            status: status.code(),
            ..Header::default()
        };
        self.writer.write(topic.row(), &header, bytemuck::bytes_of(message), now_ns).unwrap();
    }
}

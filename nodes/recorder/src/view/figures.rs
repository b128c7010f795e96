//! Commands, proposals, odometry, latency and health in numbers.

use super::Seen;
use super::channels::{COMMAND_FIGURES, EXPERT_FIGURES, HEALTHS, LATENCY, ODOMETRY_FIGURES, POLICY_FIGURES};
use super::file_time::FileTime;
use super::flat;
use super::sheet::Sheet;
use sidestep_msgs::{
    COMMAND, Code, Command, EXPERT_COMMAND, HEALTH_SIM, Header, Health, NodeState, ODOMETRY, POLICY_COMMAND,
    Proposal, Reason, Stage, Status, TOPICS_MAX, Winner, health_topic,
};

/// `[ns]` graph time between two heartbeats shown, where nothing changes.
const HEALTH_EVERY_NS: u64 = 250_000_000;
/// What a code without meaning is called.
const UNKNOWN: &str = "unknown";

/// What is remembered of numbers.
pub(crate) struct Figures {
    /// By topic: state, status and graph time of the last heartbeat shown.
    beats: [Option<(u32, u32, u64)>; TOPICS_MAX],
}

impl Default for Figures {
    fn default() -> Self {
        Self { beats: [None; TOPICS_MAX] }
    }
}

pub(crate) fn label<C: Code>(code: u32) -> &'static str {
    C::from_code(code).map_or(UNKNOWN, C::label)
}

/// `[ms]` between two host times, NaN where one is missing.
fn ms(from_ns: u64, to_ns: u64) -> f64 {
    if from_ns == 0 || to_ns < from_ns { f64::NAN } else { (to_ns - from_ns) as f64 * 1e-6 }
}

fn stage_ms(header: &Header, stage: Stage) -> f64 {
    let stamp = &header.stages[stage as usize];
    ms(stamp.receive_ns, stamp.send_ns)
}

impl Figures {
    pub(crate) fn take(&mut self, seen: &Seen, time: &FileTime, sheet: &mut Sheet) {
        if let Some(command) = seen.read(COMMAND) {
            show_command(&command, &seen.header, time, sheet);
        } else if let Some(proposal) = seen.read(POLICY_COMMAND) {
            show_proposal(&proposal, &seen.header, (POLICY_FIGURES, Stage::Policy), time, sheet);
        } else if let Some(proposal) = seen.read(EXPERT_COMMAND) {
            show_proposal(&proposal, &seen.header, (EXPERT_FIGURES, Stage::Expert), time, sheet);
        } else if let Some(odometry) = seen.read(ODOMETRY) {
            let (pose, twist) = (odometry.pose, odometry.twist);
            let values = [
                pose.x_m.into(),
                pose.y_m.into(),
                pose.yaw_rad.into(),
                twist.v_m_s.into(),
                twist.w_rad_s.into(),
                odometry.roll_rad.into(),
                odometry.pitch_rad.into(),
                odometry.slip.into(),
                odometry.pose_epoch.into(),
            ];
            let stamp = time.stamp(odometry.stamp_ns);
            sheet.fill(ODOMETRY_FIGURES, |bytes| flat::ODOMETRY.write(bytes, stamp, &values));
        } else if let Some(node) = seen.row.name.strip_prefix("health/")
            && let Some(health) = health_topic(node).and_then(|topic| seen.read(topic))
        {
            self.beat(&health, seen, time, sheet);
        }
    }

    fn beat(&mut self, health: &Health, seen: &Seen, time: &FileTime, sheet: &mut Sheet) {
        let (index, now_ns) = (seen.row.index, seen.header.now_ns);
        let same = self.beats[index].is_some_and(|(state, status, shown_ns)| {
            (state, status) == (health.state, health.status)
                && now_ns >= shown_ns
                && now_ns - shown_ns < HEALTH_EVERY_NS
        });
        if same {
            return;
        }
        self.beats[index] = Some((health.state, health.status, now_ns));
        let sum = |counts: &[u64]| counts.iter().fold(0_u64, |sum, count| sum.saturating_add(*count));
        let values = [
            label::<NodeState>(health.state).into(),
            label::<Status>(health.status).into(),
            health.state.into(),
            health.status.into(),
            seen.header.incarnation.into(),
            health.cycles.into(),
            health.misses.into(),
            health.last_frame.into(),
            (f64::from(health.worst_step_s) * 1e3).into(),
            (f64::from(health.mean_step_s) * 1e3).into(),
            sum(&health.sent).into(),
            sum(&health.lost).into(),
            sum(&health.skipped).into(),
        ];
        let Some(&channel) = HEALTHS.get(index - HEALTH_SIM.index) else { return };
        let stamp = time.stamp(now_ns);
        sheet.fill(channel, |bytes| flat::HEALTH.write(bytes, stamp, &values));
    }
}

fn show_command(command: &Command, header: &Header, time: &FileTime, sheet: &mut Sheet) {
    let stamp = time.stamp(header.now_ns);
    let values = [
        header.source_frame.into(),
        command.twist.v_m_s.into(),
        command.twist.w_rad_s.into(),
        command.wish.v_m_s.into(),
        command.wish.w_rad_s.into(),
        command.scale.into(),
        label::<Winner>(command.winner).into(),
        label::<Reason>(command.reason).into(),
        command.winner.into(),
        command.reason.into(),
        command.map_age_s.into(),
        command.goal_age_s.into(),
        command.policy_age_s.into(),
        command.expert_age_s.into(),
        command.odometry_age_s.into(),
        command.answers.into(),
        command.latched.into(),
        command.open_loop.into(),
    ];
    sheet.fill(COMMAND_FIGURES, |bytes| flat::COMMAND.write(bytes, stamp, &values));
    if command.answers == 0 {
        return;
    }
    let total_ms =
        ms(header.stages[Stage::Depth as usize].send_ns, header.stages[Stage::Arbiter as usize].send_ns);
    let values = [
        header.source_frame.into(),
        stage_ms(header, Stage::Mapper).into(),
        stage_ms(header, Stage::Goal).into(),
        stage_ms(header, Stage::Policy).into(),
        stage_ms(header, Stage::Expert).into(),
        stage_ms(header, Stage::Arbiter).into(),
        total_ms.into(),
    ];
    sheet.fill(LATENCY, |bytes| flat::LATENCY.write(bytes, stamp, &values));
}

fn show_proposal(
    proposal: &Proposal,
    header: &Header,
    (channel, stage): (usize, Stage),
    time: &FileTime,
    sheet: &mut Sheet,
) {
    let values = [
        header.source_frame.into(),
        proposal.twist.v_m_s.into(),
        proposal.twist.w_rad_s.into(),
        proposal.doubt_v_m_s.into(),
        proposal.doubt_w_rad_s.into(),
        proposal.cost.into(),
        proposal.evaluated.into(),
        label::<Status>(header.status).into(),
        header.status.into(),
        stage_ms(header, stage).into(),
    ];
    let stamp = time.stamp(proposal.capture_ns);
    sheet.fill(channel, |bytes| flat::PROPOSAL.write(bytes, stamp, &values));
}

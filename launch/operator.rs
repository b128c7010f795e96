//! What a person says to a run: emergency stop, reset, hold, resume, teleop.

use crate::failure::Failure;
use crate::look::{join, only_run, runs};
use sidestep_bus::{DomainName, Keep, Link, Outbox, Step, host_ns, pause};
use sidestep_msgs::{COMMAND, Code, ESTOP, Estop, EstopAction, Reason, Stage, TELEOP, Teleop, Twist};
use std::time::Duration;

/// `[ns]` time the arbiter has to acknowledge.
const ACKNOWLEDGE_NS: u64 = 2_000_000_000;
/// `[ns]` pause before the same message is said again: a reset counts only once the robot stands.
const REPEAT_NS: u64 = 100_000_000;
/// `[ns]` time to wait for another operator's message to leave the topic.
const TURN_NS: u64 = 1_000_000_000;
/// Pace of teleop wishes.
const WISH_EVERY: Duration = Duration::from_millis(20);

/// Says one thing to a run and waits for the arbiter's acknowledgement. An emergency stop asks no questions: it goes to
/// every run of this user at once.
///
/// # Errors
/// Exit code 2 where several runs live and the action is no stop, 3 where none does or somebody does not acknowledge.
pub(crate) fn say(action: EstopAction) -> Result<String, Failure> {
    if action != EstopAction::Stop {
        return say_to(&only_run()?, action);
    }
    let runs = runs()?;
    let answers: Vec<_> = std::thread::scope(|scope| {
        let said: Vec<_> = runs.iter().map(|run| scope.spawn(|| say_to(run, action))).collect();
        said.into_iter().map(std::thread::ScopedJoinHandle::join).collect()
    });
    let unheard = || Failure::io("the emergency stop broke off; see `sidestep top`");
    let lines: Result<Vec<_>, _> =
        answers.into_iter().map(|answer| answer.unwrap_or_else(|_| Err(unheard()))).collect();
    Ok(lines?.join("\n"))
}

fn say_to(run: &DomainName, action: EstopAction) -> Result<String, Failure> {
    let mut link = join(run, "operator")?;
    let mut commands = link.inbox(COMMAND, Keep::Newest)?;
    let mut step = Step::new();
    let token = host_ns() | 1;
    let mut outbox = turn(&link)?;
    let until_ns = host_ns() + ACKNOWLEDGE_NS;
    let mut due_ns = 0;
    while host_ns() < until_ns {
        link.look(&mut step)?;
        if host_ns() >= due_ns {
            due_ns = host_ns() + REPEAT_NS;
            step.originate(0, Stage::Arbiter);
            outbox.send(&mut step, |estop| *estop = Estop { token, action: action as u32, _pad: 0 })?;
        }
        if let Some(command) = commands.newest(&mut step)?
            && command.operator_token == token
        {
            let reason = Reason::from_code(command.reason).map_or("unknown reason", Reason::label);
            return Ok(format!("{} acknowledged; the robot: {reason}", action.label()));
        }
        pause(Duration::from_millis(2));
    }
    let why = format!(
        "{} was not acknowledged within 2 s; is the arbiter alive, and does the robot stand? see `sidestep top`",
        action.label()
    );
    Err(Failure::io(why))
}

/// Waits for its turn to write: operators share the topic for one message each.
fn turn(link: &Link) -> Result<Outbox<Estop>, Failure> {
    let until_ns = host_ns() + TURN_NS;
    loop {
        match link.outbox(ESTOP) {
            Ok(outbox) => return Ok(outbox),
            Err(error) if host_ns() >= until_ns => return Err(error.into()),
            Err(_) => pause(Duration::from_millis(5)),
        }
    }
}

/// The stick in an operator's hand; whoever drops it stops wishing, and the arbiter stops the robot.
pub(crate) struct Wishes {
    pub(crate) link: Link,
    pub(crate) step: Step,
    outbox: Outbox<Teleop>,
}

impl Wishes {
    /// Takes the stick of a run.
    ///
    /// # Errors
    /// Exit code 3 where the run cannot be joined or another operator holds the stick.
    pub(crate) fn take(run: &DomainName) -> Result<Self, Failure> {
        let link = join(run, "teleop")?;
        let outbox = link.outbox(TELEOP)?;
        Ok(Self { link, step: Step::new(), outbox })
    }

    /// Wishes a velocity, or nothing with the dead man's switch released.
    ///
    /// # Errors
    /// Exit code 3 where the transport fails.
    pub(crate) fn wish(&mut self, twist: Option<Twist>) -> Result<(), Failure> {
        self.link.look(&mut self.step)?;
        let stamp_ns = self.step.now_ns();
        let (held, dead_man) = (twist.unwrap_or(Twist::STOP), u32::from(twist.is_some()));
        let wish = Teleop { stamp_ns, v_m_s: held.v_m_s, w_rad_s: held.w_rad_s, dead_man, _pad: 0 };
        Ok(self.outbox.send(&mut self.step, |teleop| *teleop = wish)?)
    }
}

/// Drives with a constant wish while this command runs, the dead man's switch held; releases it at the end.
///
/// # Errors
/// Exit code 2 where several runs live, 3 where none does or another operator holds the stick.
pub(crate) fn teleop(v_m_s: f32, w_rad_s: f32, time: Duration) -> Result<(), Failure> {
    let mut wishes = Wishes::take(&only_run()?)?;
    let until_ns = host_ns() + time.as_nanos() as u64;
    while host_ns() < until_ns {
        wishes.wish(Some(Twist::new(v_m_s, w_rad_s)))?;
        pause(WISH_EVERY);
    }
    wishes.wish(None)
}

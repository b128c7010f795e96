//! An operator who drives through the arbiter's filter and listens to what was sent and what moved.

use crate::failure::Failure;
use crate::operator::Wishes;
use sidestep_bus::{DomainName, Inbox, Keep, host_ns, pause};
use sidestep_identify::Series;
use sidestep_msgs::{COMMAND, Code, Command, ODOMETRY, Odometry, Reason, Robot, Twist, wrap_angle};
use std::time::Duration;

/// Pace of wishes and of listening.
const EVERY: Duration = Duration::from_millis(10);

/// The stick in the operator's hand, with an ear for what comes of it.
pub(crate) struct Stick {
    wishes: Wishes,
    commands: Inbox<Command>,
    odometry: Inbox<Odometry>,
    reason: u32,
    yaw_rad: f64,
    /// `[rad]` all turning so far, counter-clockwise.
    pub(crate) turned_rad: f64,
    /// What was sent and what moved so far.
    pub(crate) series: Series,
}

impl Stick {
    /// Takes the stick of a run.
    ///
    /// # Errors
    /// Exit code 3 where the run cannot be joined or another operator holds the stick.
    pub(crate) fn take(run: &DomainName) -> Result<Self, Failure> {
        let wishes = Wishes::take(run)?;
        let (commands, odometry) =
            (wishes.link.inbox(COMMAND, Keep::All)?, wishes.link.inbox(ODOMETRY, Keep::All)?);
        let series = Series::default();
        let (reason, yaw_rad, turned_rad) = (u32::MAX, f64::NAN, 0.0);
        Ok(Self { wishes, commands, odometry, reason, yaw_rad, turned_rad, series })
    }

    /// Wishes a velocity, or nothing with the dead man's switch released, and takes what came.
    ///
    /// # Errors
    /// Exit code 3 where the transport fails.
    pub(crate) fn wish(&mut self, twist: Option<Twist>) -> Result<(), Failure> {
        self.wishes.wish(twist)?;
        let (series, reason) = (&mut self.series, &mut self.reason);
        self.commands.each(&mut self.wishes.step, |command, header| {
            series.command(command, header.now_ns);
            *reason = command.reason;
        })?;
        let (yaw_rad, turned_rad) = (&mut self.yaw_rad, &mut self.turned_rad);
        self.odometry.each(&mut self.wishes.step, |odometry, _| {
            series.odometry(odometry);
            if yaw_rad.is_finite() {
                *turned_rad += wrap_angle(odometry.pose.yaw_rad - *yaw_rad);
            }
            *yaw_rad = odometry.pose.yaw_rad;
        })?;
        pause(EVERY);
        Ok(())
    }

    /// Wishes the same for a span of host time.
    ///
    /// # Errors
    /// As [`Stick::wish`].
    pub(crate) fn hold(&mut self, twist: Option<Twist>, span_ns: u64) -> Result<(), Failure> {
        let until_ns = host_ns() + span_ns;
        while host_ns() < until_ns {
            self.wish(twist)?;
        }
        Ok(())
    }

    /// What the arbiter said last.
    pub(crate) fn reason(&self) -> &'static str {
        Reason::from_code(self.reason).map_or("no command", Reason::label)
    }
}

/// The robot file of a live run, with its text.
///
/// # Errors
/// Exit code 2 where the run has none that can be read.
pub(crate) fn robot_of_run(run: &DomainName) -> Result<(Robot, String), Failure> {
    let files = run.files();
    let bytes = files.iter().find(|(name, _)| name == "robot.toml").map(|(_, bytes)| bytes.clone());
    let text = String::from_utf8_lossy(&bytes.unwrap_or_default()).into_owned();
    let robot = Robot::from_toml("robot.toml of the run", &text);
    Ok((robot.map_err(|error| Failure::usage(error.to_string()))?, text))
}

/// A speed that steps can be driven at.
///
/// # Errors
/// Exit code 2 with the range.
pub(crate) fn may_drive_at(v_m_s: f32) -> Result<(), Failure> {
    if (0.25..=1.0).contains(&v_m_s) {
        return Ok(());
    }
    Err(Failure::usage(format!("--speed is {v_m_s}, needed: 0.25 to 1.0 m/s")))
}

//! What a person said, and what a restart demands: the modes in which nothing drives, whatever is wished.

use crate::config::Resume;
use bytemuck::{Pod, Zeroable};
use sidestep_msgs::{Code, Estop, EstopAction, Reason};

/// What a person ordered to stay, and what therefore outlives the arbiter's own end.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Standing {
    /// The emergency stop is latched.
    pub latched: bool,
    /// The robot is held.
    pub held: bool,
}

/// The modes.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Operator {
    /// Token of the last message obeyed.
    pub(crate) token: u64,
    /// 1 while the emergency stop is latched.
    latched: u32,
    /// 1 while held.
    held: u32,
    /// 1 while the robot brakes to rest after the arbiter's own restart.
    starting: u32,
    /// 1 while an operator must say go.
    awaiting: u32,
}

impl Operator {
    /// After a restart the robot first brakes to rest.
    pub(crate) fn new(restarted: bool) -> Self {
        Self { starting: u32::from(restarted), ..Self::zeroed() }
    }

    /// The orders that stand.
    pub(crate) fn standing(&self) -> Standing {
        Standing { latched: self.latched != 0, held: self.held != 0 }
    }

    /// Takes up the orders of an earlier life.
    pub(crate) fn take_up(&mut self, standing: Standing) {
        self.latched |= u32::from(standing.latched);
        self.held |= u32::from(standing.held);
    }

    /// Obeys a message; a reset only at rest. Returns the action if it was obeyed.
    pub(crate) fn obey(&mut self, message: &Estop, at_rest: bool, resume: Resume) -> Option<EstopAction> {
        let action = EstopAction::from_code(message.action)?;
        match action {
            EstopAction::Stop => self.latched = 1,
            EstopAction::Reset if !at_rest => return None,
            // A reset of the latch does not start the robot where an operator must (ISO 3691-4).
            EstopAction::Reset if self.latched != 0 => {
                self.latched = 0;
                self.awaiting = u32::from(resume == Resume::Operator);
            }
            EstopAction::Reset => self.awaiting = 0,
            EstopAction::Hold => self.held = 1,
            EstopAction::Resume => {
                self.held = 0;
                self.awaiting = 0;
            }
        }
        self.token = message.token;
        Some(action)
    }

    /// The robot is at rest: a start, if there was one, is over.
    pub(crate) fn rested(&mut self, resume: Resume) {
        if self.starting != 0 {
            self.starting = 0;
            self.awaiting = u32::from(resume == Resume::Operator);
        }
    }

    /// The reason to stop, in the order of their strength.
    pub(crate) fn stop(&self) -> Option<Reason> {
        [
            (self.latched, Reason::EstopLatched),
            (self.held, Reason::Hold),
            (self.starting, Reason::Starting),
            (self.awaiting, Reason::AwaitOperator),
        ]
        .into_iter()
        .find_map(|(flag, reason)| (flag != 0).then_some(reason))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ACTIONS: [EstopAction; 4] =
        [EstopAction::Stop, EstopAction::Reset, EstopAction::Hold, EstopAction::Resume];

    fn say(action: EstopAction) -> Estop {
        Estop { token: 7, action: action as u32, _pad: 0 }
    }

    /// Every order of five messages, at rest or moving, in both modes of resuming.
    #[test]
    fn only_a_reset_at_rest_ends_a_latch_whatever_else_is_said() {
        for resume in [Resume::Auto, Resume::Operator] {
            for order in 0..8usize.pow(5) {
                let mut operator = Operator::new(false);
                let mut latched = false;
                for place in 0..5 {
                    let pick = order / 8usize.pow(place) % 8;
                    let (action, at_rest) = (ACTIONS[pick % 4], pick >= 4);
                    operator.obey(&say(action), at_rest, resume);
                    latched = match action {
                        EstopAction::Stop => true,
                        EstopAction::Reset if at_rest => false,
                        _ => latched,
                    };
                    assert_eq!(operator.standing().latched, latched, "order {order}");
                    assert!(!latched || operator.stop() == Some(Reason::EstopLatched));
                }
            }
        }
    }

    #[test]
    fn an_operator_who_must_resume_resets_first_and_then_says_go() {
        let mut operator = Operator::new(false);
        operator.take_up(Standing { latched: true, held: false });
        assert_eq!(operator.obey(&say(EstopAction::Reset), false, Resume::Operator), None);
        assert_eq!(operator.token, 0, "a refused reset is not acknowledged");
        assert!(operator.obey(&say(EstopAction::Reset), true, Resume::Operator).is_some());
        assert_eq!(operator.stop(), Some(Reason::AwaitOperator));
        operator.obey(&say(EstopAction::Reset), true, Resume::Operator);
        assert_eq!((operator.stop(), operator.token), (None, 7));
    }

    #[test]
    fn an_unknown_action_is_not_acknowledged() {
        let mut operator = Operator::new(false);
        assert_eq!(operator.obey(&Estop { token: 9, action: 77, _pad: 0 }, true, Resume::Auto), None);
        assert_eq!(operator.token, 0);
    }
}

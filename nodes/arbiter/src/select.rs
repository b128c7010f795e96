//! Whose wish drives: the lead's while it is fit, else the other's, and back with hysteresis.

use crate::config::{Config, Lead, span_ns};
use crate::inputs::{Inputs, Wish};
use bytemuck::{Pod, Zeroable};
use sidestep_msgs::{Reason, Status, Twist, Winner};

/// A doubt below this part of its limit is no doubt again.
const RELIEF: f32 = 0.8;

/// What the selection keeps from step to step.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Selection {
    /// `[ns]` graph time since which the lead is fit without a break; 0 = it is not.
    good_since_ns: u64,
    /// Good frames of the lead when it became fit.
    good_from: u32,
    /// 1 while the other drives because the lead failed.
    other_drives: u32,
    /// 1 while the policy is in doubt.
    in_doubt: u32,
    _pad: u32,
}

/// A wish with its origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Selected {
    pub(crate) winner: Winner,
    pub(crate) twist: Twist,
    pub(crate) source_frame: u64,
    pub(crate) reason: Reason,
}

impl Selection {
    /// Notes whether the lead is fit, and since when: at every step, whoever drives.
    pub(crate) fn watch(&mut self, inputs: &Inputs, config: &Config, now_ns: u64) {
        let doubt = self.doubt(&inputs.policy, config);
        let (lead, doubt) = match config.lead {
            Lead::Policy => (&inputs.policy, doubt),
            Lead::Expert => (&inputs.expert, false),
        };
        let fit = lead.is_usable(now_ns, config.proposal_age_s) && !doubt;
        self.count(lead, fit, now_ns);
    }

    /// The wish that drives, after [`Selection::watch`].
    ///
    /// # Errors
    /// The reason to stop.
    pub(crate) fn select(
        &mut self,
        inputs: &Inputs,
        config: &Config,
        now_ns: u64,
    ) -> Result<Selected, Reason> {
        let usable = |wish: &Wish| wish.is_usable(now_ns, config.proposal_age_s);
        let (policy, expert) = (&inputs.policy, &inputs.expert);
        let (lead, other, lead_winner, other_winner) = match config.lead {
            Lead::Policy => (policy, expert, Winner::Policy, Winner::Expert),
            Lead::Expert => (expert, policy, Winner::Expert, Winner::Policy),
        };
        let lead_fit = self.good_since_ns != 0;
        let chosen = |wish: &Wish, winner, reason| Selected {
            winner,
            twist: wish.twist,
            source_frame: wish.source_frame,
            reason,
        };
        if !usable(other) {
            // A doubtful lead is better than none.
            self.other_drives = u32::from(!lead_fit);
            if usable(lead) {
                return Ok(chosen(lead, lead_winner, Reason::Clear));
            }
            // Infeasible proposals do not refresh the stamp, but their sender lives: told apart by the newest message.
            let refuses = |wish: &Wish| wish.refuses(now_ns, config.proposal_age_s);
            let unfit = refuses(policy) || refuses(expert);
            return Err(if unfit { Reason::UnfitProposals } else { Reason::StaleProposals });
        }
        if !lead_fit {
            self.other_drives = 1;
        } else if self.other_drives != 0 && self.is_back(lead, config, now_ns) {
            self.other_drives = 0;
        }
        Ok(if self.other_drives != 0 {
            chosen(other, other_winner, Reason::OtherProposal)
        } else {
            chosen(lead, lead_winner, Reason::Clear)
        })
    }

    /// Whether a proposer lives and finds no admissible motion.
    pub(crate) fn is_infeasible(inputs: &Inputs, config: &Config, now_ns: u64) -> bool {
        [&inputs.policy, &inputs.expert].into_iter().any(|wish| {
            wish.status == Status::Infeasible as u32 && wish.refuses(now_ns, config.proposal_age_s)
        })
    }

    fn doubt(&mut self, policy: &Wish, config: &Config) -> bool {
        let relief = if self.in_doubt != 0 { RELIEF } else { 1.0 };
        // NaN fails the comparison: no measure of doubt, no doubt.
        let above = policy.doubt_v_m_s > relief * config.doubt_limit_m_s
            || policy.doubt_w_rad_s > relief * config.doubt_limit_rad_s;
        self.in_doubt = u32::from(above);
        above
    }

    fn count(&mut self, lead: &Wish, fit: bool, now_ns: u64) {
        if !fit {
            self.good_since_ns = 0;
        } else if self.good_since_ns == 0 {
            self.good_since_ns = now_ns.max(1);
            self.good_from = lead.good.saturating_sub(1);
        }
    }

    fn is_back(&self, lead: &Wish, config: &Config, now_ns: u64) -> bool {
        let frames = lead.good.saturating_sub(self.good_from);
        frames >= config.lead_frames
            || now_ns.saturating_sub(self.good_since_ns) >= span_ns(config.lead_good_s)
    }
}

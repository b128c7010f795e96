//! Policy and expert of a replay: they keep only maps that wait for their goal.

use crate::error::ReplayError;
use crate::nodes::{Again, Output, refused, status_of};
use crate::settings::Settings;
use sidestep_expert::{Config, Expert, Lead, Pairing};
use sidestep_msgs::{
    Code, EXPERT_COMMAND, LOCAL_GOAL, LOCAL_MAP, LocalGoal, LocalMap, POLICY_COMMAND, Proposal, Status,
};
use sidestep_player::Entry;
use sidestep_policy::{KeptMaps, Policy};

/// Whether a recorded step had no map for its goal.
fn lacked_map(recorded: &Entry) -> bool {
    recorded.header.status == Status::NoMap.code()
}

pub(crate) struct PolicyAgain {
    policy: Policy,
    kept: KeptMaps,
    goal: Option<Entry>,
}

impl PolicyAgain {
    pub(crate) fn new(settings: &Settings) -> Result<Self, ReplayError> {
        let policy = Policy::load(&settings.onnx, &settings.model_name, &settings.robot);
        let policy = policy.map_err(|error| refused(&error))?;
        Ok(Self { policy, kept: KeptMaps::default(), goal: None })
    }
}

impl Again for PolicyAgain {
    fn take(&mut self, entry: &Entry) {
        if let Some(map) = entry.read(LOCAL_MAP) {
            self.kept.keep(&map, entry.header.sequence);
        } else if entry.topic == LOCAL_GOAL.index {
            self.goal = Some(entry.clone());
        }
    }

    fn step(&mut self, recorded: &Entry) -> Option<Vec<Output>> {
        let entry = self.goal.take()?;
        let goal: LocalGoal = entry.read(LOCAL_GOAL)?;
        let mut out = Proposal::default();
        let status = match self.kept.of(&goal) {
            Some(map) => self.policy.propose(map, &goal, status_of(&entry.header), &mut out),
            None if lacked_map(recorded) => {
                self.policy.propose(&LocalMap::default(), &goal, Status::NoMap, &mut out)
            }
            None => return None,
        };
        Some(vec![Output::new(POLICY_COMMAND.index, entry.header.source_frame, status, &out)])
    }

    fn reset(&mut self) {
        self.kept.forget();
    }
}

pub(crate) struct ExpertAgain {
    expert: Expert,
    pairing: Pairing,
    refines: bool,
}

impl ExpertAgain {
    pub(crate) fn new(settings: &Settings) -> Result<Self, ReplayError> {
        let config: Config = settings.graph.config("expert").map_err(|error| refused(&error))?;
        let config = config.led_by(settings.graph.lead());
        let expert = Expert::new(&config, &settings.robot).map_err(|error| refused(&error))?;
        let refines = config.mode == Lead::Refined;
        Ok(Self { expert, pairing: Pairing::new(refines.then_some(0)), refines })
    }
}

impl Again for ExpertAgain {
    fn take(&mut self, entry: &Entry) {
        if let Some(map) = entry.read(LOCAL_MAP) {
            self.pairing.map(&map, &entry.header);
        } else if let Some(goal) = entry.read(LOCAL_GOAL) {
            // The recorded step says when the waiting ended: at its own time, which is after any deadline from 0.
            self.pairing.goal(&goal, &entry.header, 0);
        } else if let Some(proposal) = entry.read(POLICY_COMMAND).filter(|_| self.refines) {
            self.pairing.policy(&proposal, &entry.header);
        }
    }

    fn step(&mut self, recorded: &Entry) -> Option<Vec<Output>> {
        let (frame, seed) = self.pairing.ready(recorded.header.now_ns)?;
        let mut out = Proposal::default();
        let status = match self.pairing.map_of(&frame.goal) {
            Some(map) => self.expert.plan(map, &frame.goal, status_of(&frame.header), seed, &mut out),
            None if lacked_map(recorded) => {
                self.expert.plan(&LocalMap::default(), &frame.goal, Status::NoMap, None, &mut out)
            }
            None => return None,
        };
        Some(vec![Output::new(EXPERT_COMMAND.index, frame.header.source_frame, status, &out)])
    }

    fn reset(&mut self) {
        self.pairing.reset();
    }
}

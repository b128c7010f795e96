//! Maps that wait for their goal.

use sidestep_msgs::{LocalGoal, LocalMap};

/// Maps kept until their goal arrives.
const MAPS: usize = 4;

/// The newest maps by sequence, the oldest overwritten.
#[derive(Debug)]
pub struct KeptMaps {
    maps: [(u64, LocalMap); MAPS],
    next: usize,
}

impl Default for KeptMaps {
    fn default() -> Self {
        Self { maps: [(0, LocalMap::default()); MAPS], next: 0 }
    }
}

impl KeptMaps {
    /// Keeps a map under its sequence.
    pub fn keep(&mut self, map: &LocalMap, sequence: u64) {
        self.maps[self.next] = (sequence, *map);
        self.next = (self.next + 1) % MAPS;
    }

    /// Forgets them all: graph time jumped.
    pub fn forget(&mut self) {
        self.maps.iter_mut().for_each(|(sequence, _)| *sequence = 0);
    }

    /// The map that a goal names, if it is still there.
    #[must_use]
    pub fn of(&self, goal: &LocalGoal) -> Option<&LocalMap> {
        let named = |(sequence, _): &&(u64, LocalMap)| *sequence == goal.map_sequence && *sequence != 0;
        self.maps.iter().find(named).map(|(_, map)| map)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_goal_finds_the_map_it_names_until_four_others_came_or_time_jumped() {
        let mut kept = KeptMaps::default();
        let goal = |map_sequence| LocalGoal { map_sequence, ..LocalGoal::default() };
        assert!(kept.of(&goal(0)).is_none());
        for sequence in 1..=5 {
            kept.keep(&LocalMap { capture_ns: 10 * sequence, ..LocalMap::default() }, sequence);
        }
        assert!(kept.of(&goal(1)).is_none());
        assert_eq!(kept.of(&goal(2)).map(|map| map.capture_ns), Some(20));
        kept.forget();
        assert!(kept.of(&goal(5)).is_none());
    }
}

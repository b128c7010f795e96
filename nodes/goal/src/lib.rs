//! sidestep-goal

//! sidestep-sim

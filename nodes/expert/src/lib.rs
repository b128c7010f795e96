//! sidestep-expert

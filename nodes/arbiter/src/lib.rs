//! sidestep-arbiter

//! sidestep-bus

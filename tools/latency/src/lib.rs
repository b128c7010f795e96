//! sidestep-latency

//! sidestep-train

//! sidestep-recorder

//! sidestep-player

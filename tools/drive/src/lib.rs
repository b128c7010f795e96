//! sidestep-drive

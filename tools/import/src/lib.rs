//! sidestep-import

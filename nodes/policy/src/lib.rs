//! sidestep-policy

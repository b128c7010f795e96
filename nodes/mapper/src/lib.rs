//! sidestep-mapper

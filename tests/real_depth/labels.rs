//! Hand-drawn labels.

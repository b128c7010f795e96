//! Runs the nodes of a recording again, step by step, and compares every byte.

//! What the arbiter promises, each promise a test.

mod closed_loop;

//! What the arbiter promises, each promise a test.

mod arbitration;
mod closed_loop;
mod escapes;
mod garbage;
mod modes;
mod movers;
mod pauses;
mod properties;
mod reasons;
mod sweep;
mod trust;
mod ways_out;

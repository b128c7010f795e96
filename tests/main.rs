//! Scenario tests: the binary as a user runs it, real processes, real shared memory. One index, one binary.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    missing_docs,
    reason = "a test says what it expects by failing, and what it measured by printing"
)]

// The rules of the house, read from the text of the tree.
mod tidy;

// What every scenario needs: the binary, its summary, processes by name, time limits.
mod harness;

// Messages of the command line: every error a user can cause, with its exit code.
mod command_line;

// The default drive, as a newcomer sees it.
mod drive;

// Killed and hung nodes, operators, orphans: the robot stops in time, the graph comes back, nothing is left.
mod faults;

// Liveness by the hundred: nodes stopped at random moments, the times to the answer.
mod injections;

// Graph time in steps: the same seed, the same bytes.
mod lockstep;

// Shared memory without room: refused before the start.
mod full_memory;

// Input that no driver should send: refused with a reason, and survived.
mod abnormal;

// No step allocates after its start.
mod allocations;

// BARN worlds with a lidar robot, the whole chain in one process.
mod barn;

// The mapper on depth that real cameras saw.
mod real_depth;

// Graph files and shipped configurations agree.
mod shipped;

// Recordings as a user meets them.
mod recordings;

// A recorded drive again, byte for byte.
mod replay;
// A run on the screen of a viewer.
mod live;
// The recorder in the field: killed, split, asked for the last seconds, beside another, before a full disk.
mod recorder;
// Drivers in other languages.
mod driver;
// ROS 2 bags in and out.
mod bags;
// Recordings played in lockstep, in part, by the keyboard; and saved from a cut.
mod play;
// Where policy and expert disagree in a recording.
mod compare;
// Learning as a user meets it: data set, training, evaluation, closed loops.
mod learning;
// What a base really does: step tests, its watchdog, and the checks before a drive.
mod identify;
// Each guard of the arbiter taken away: a test misses it.
mod guards;

//! Time of one step.

fn main() {
    divan::main();
}

//! The promises of the model in the binary.
#![allow(clippy::unwrap_used, clippy::float_cmp, reason = "a test fails by panicking")]

use sidestep_msgs::{Robot, Twist};
use sidestep_policy::{Policy, embedded};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

#[allow(unsafe_code, reason = "an allocator that counts, for the test that counts allocations")]
// SAFETY: everything is handed on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promise, handed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise, handed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn robot() -> Robot {
    Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml")).unwrap()
}

#[test]
fn the_embedded_model_passes_its_contract_and_runs_fused() {
    let policy = Policy::load(embedded(), "embedded", &robot()).unwrap();
    assert_eq!(policy.warning(), None);
    assert_eq!(policy.contract().rounds, 36);
}

#[test]
fn the_embedded_model_gives_plain_tracts_answer() {
    let mut fused = Policy::load(embedded(), "embedded", &robot()).unwrap();
    let mut plain = Policy::load_plain(embedded(), "embedded", &robot()).unwrap();
    let mut map = fused.contract().golden.planning_cost;
    for goal in (0..784).step_by(97) {
        map.rotate_left(28);
        let twist = Twist::new(goal as f32 / 784.0, 0.7);
        let (a, b) = (fused.infer(&map, goal, twist).unwrap(), plain.infer(&map, goal, twist).unwrap());
        let pairs = a.command.into_iter().zip(b.command).chain(a.doubt.into_iter().zip(b.doubt));
        for (a, b) in pairs {
            assert!((a - b).abs() < 1e-5 * (1.0 + b.abs()), "goal {goal}: {a} {b}");
        }
    }
}

#[test]
fn an_inference_allocates_a_small_constant_number_of_times() {
    let mut policy = Policy::load(embedded(), "embedded", &robot()).unwrap();
    let map = policy.contract().golden.planning_cost;
    let mut count = |goal| {
        let before = ALLOCATIONS.with(Cell::get);
        policy.infer(&map, goal, Twist::new(0.3, 0.1)).unwrap();
        ALLOCATIONS.with(Cell::get) - before
    };
    count(1);
    let counts: Vec<usize> = (0..20).map(&mut count).collect();
    println!("allocations per inference: {}", counts[0]);
    assert!(counts.iter().all(|count| *count == counts[0] && *count < 100), "{counts:?}");
}

/// Asks onnxruntime, an independent implementation, where Python has it.
#[test]
fn onnxruntime_gives_the_same_answer() {
    let python = std::env::var("SIDESTEP_PYTHON").unwrap_or("python3".into());
    let ready = std::process::Command::new(&python).args(["-c", "import onnx, onnxruntime"]).output();
    if !ready.is_ok_and(|output| output.status.success()) {
        println!("skipped: {python} has no onnx and onnxruntime (pip install onnx onnxruntime)");
        return;
    }
    let path = std::env::temp_dir().join(format!("sidestep-{}.onnx", std::process::id()));
    std::fs::write(&path, embedded()).unwrap();
    let script = include_str!("onnxruntime.py");
    let output = std::process::Command::new(&python).args(["-c", script]).arg(&path).output().unwrap();
    std::fs::remove_file(&path).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    println!("{}", String::from_utf8_lossy(&output.stdout));
}

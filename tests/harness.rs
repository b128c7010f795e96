//! Runs the binary as a user would, with a limit in time, and reads its summary.

use serde_json::Value;
use sidestep_bus::{DomainName, environment};
use std::io::Read;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Time after which a command that should have ended is killed and the test fails.
const WATCHDOG: Duration = Duration::from_secs(180);

/// A small image: tests about processes and files share the machine.
pub(crate) const SMALL: &[&str] = &["--set", "sim.width_px=160", "--set", "sim.height_px=120"];
/// Supervision for tests on a loaded machine: restarts without end or pause, and patience with slow starts.
pub(crate) const PATIENT: &[&str] = &[
    "--set",
    "supervision.restarts_most=1000000",
    "--set",
    "supervision.delay_most_ms=1",
    "--set",
    "supervision.hang_ms=5000",
    "--set",
    "supervision.start_ms=60000",
];

/// One graph at a time: two would share two cores, and each would see the other's load as its own fault.
pub(crate) struct Alone(#[allow(dead_code, reason = "held, not read")] MutexGuard<'static, ()>);

impl Alone {
    pub(crate) fn wait() -> Self {
        static MACHINE: Mutex<()> = Mutex::new(());
        // A test that failed while it held the machine has ended its processes.
        Self(MACHINE.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// What a command printed and how it ended.
#[derive(Debug)]
pub(crate) struct Outcome {
    /// Exit code; -1 for a signal.
    pub(crate) code: i32,
    /// Standard output.
    pub(crate) out: String,
    /// Standard error.
    pub(crate) err: String,
}

/// A folder that is removed at the end of the test.
#[derive(Debug)]
pub(crate) struct Folder(pub(crate) PathBuf);

impl Folder {
    pub(crate) fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("sidestep-test-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    pub(crate) fn join(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Writes a file and returns its path as text.
    pub(crate) fn write(&self, name: &str, text: &str) -> String {
        let path = self.join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// The command with its arguments, in the repository's root.
pub(crate) fn sidestep(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sidestep"));
    command.args(arguments).current_dir(env!("CARGO_MANIFEST_DIR")).stdin(Stdio::null());
    command
}

/// What a child prints, read from its first line on: a full pipe would hold it up.
#[derive(Debug)]
struct Readers([JoinHandle<String>; 2]);

impl Readers {
    fn of(child: &mut Child) -> Self {
        fn read(mut stream: impl Read + Send + 'static) -> JoinHandle<String> {
            std::thread::spawn(move || {
                let mut text = String::new();
                let _ = stream.read_to_string(&mut text);
                text
            })
        }
        Self([read(child.stdout.take().unwrap()), read(child.stderr.take().unwrap())])
    }

    /// Waits for the child with the watchdog and gathers what it printed.
    fn finish(self, mut child: Child) -> Outcome {
        let Self([out, err]) = self;
        let deadline_ns = sidestep_bus::host_ns() + WATCHDOG.as_nanos() as u64;
        let status = loop {
            if let Some(status) = child.try_wait().unwrap() {
                break status;
            }
            if sidestep_bus::host_ns() > deadline_ns {
                let _ = child.kill();
                let _ = child.wait();
                panic!("not ended after {WATCHDOG:?}:\n{}{}", out.join().unwrap(), err.join().unwrap());
            }
            sidestep_bus::pause(Duration::from_millis(5));
        };
        Outcome { code: status.code().unwrap_or(-1), out: out.join().unwrap(), err: err.join().unwrap() }
    }
}

/// Waits for a child and gathers what it printed.
pub(crate) fn finish(mut child: Child) -> Outcome {
    Readers::of(&mut child).finish(child)
}

/// Runs a command to its end.
pub(crate) fn run(arguments: &[&str]) -> Outcome {
    let child = sidestep(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    finish(child)
}

/// Runs `sidestep ARGUMENTS --json FILE` and returns the outcome with the summary.
pub(crate) fn run_with_summary(name: &str, arguments: &[&str]) -> (Outcome, Value) {
    let folder = Folder::new(name);
    let json = folder.join("summary.json").display().to_string();
    let outcome = run(&[arguments, &["--json", &json]].concat());
    let text = std::fs::read_to_string(&json)
        .unwrap_or_else(|_| panic!("no summary: {}{}", outcome.out, outcome.err));
    (outcome, serde_json::from_str(&text).unwrap())
}

/// A run in the background, watched from outside.
#[derive(Debug)]
pub(crate) struct Running {
    child: Option<Child>,
    readers: Option<Readers>,
}

impl Running {
    /// Starts `sidestep ARGUMENTS`.
    pub(crate) fn start(mut command: Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let readers = Some(Readers::of(&mut child));
        Self { child: Some(child), readers }
    }

    /// Process number of the launcher.
    pub(crate) fn launcher(&self) -> u32 {
        self.child.as_ref().unwrap().id()
    }

    /// Process number of a node, or of any child whose name it begins.
    pub(crate) fn node(&self, name: &str) -> Option<u32> {
        let launcher = self.launcher();
        let children =
            std::fs::read_to_string(format!("/proc/{launcher}/task/{launcher}/children")).unwrap_or_default();
        let wanted = format!("sidestep-{name}");
        children.split_whitespace().filter_map(|id| id.parse().ok()).find(|id: &u32| {
            let line = std::fs::read(format!("/proc/{id}/cmdline")).unwrap_or_default();
            line.split(|&byte| byte == 0).next().is_some_and(|program| program == wanted.as_bytes())
        })
    }

    /// The shared memory of the run, as one of its nodes was told it.
    pub(crate) fn domain(&self, node: &str) -> Option<DomainName> {
        let text = std::fs::read(format!("/proc/{}/environ", self.node(node)?)).ok()?;
        let text = String::from_utf8_lossy(&text).into_owned();
        let value = |name: &str| {
            text.split('\0').find_map(|line| line.strip_prefix(name)?.strip_prefix('=').map(str::to_owned))
        };
        Some(DomainName { prefix: value(environment::DOMAIN)?, root: value(environment::ROOT)?.into() })
    }

    /// Waits until something holds; fails when the run ends first or the watchdog barks.
    pub(crate) fn wait_for<T>(&mut self, what: &str, mut holds: impl FnMut(&Self) -> Option<T>) -> T {
        let deadline_ns = sidestep_bus::host_ns() + WATCHDOG.as_nanos() as u64;
        loop {
            if let Some(value) = holds(self) {
                return value;
            }
            let ended = self.child.as_mut().unwrap().try_wait().unwrap().is_some();
            if ended || sidestep_bus::host_ns() > deadline_ns {
                let _ = self.child.as_mut().unwrap().kill();
                let outcome = self.gather();
                panic!("waited for {what}:\n{}{}", outcome.out, outcome.err);
            }
            sidestep_bus::pause(Duration::from_millis(2));
        }
    }

    /// Sends a signal to the launcher.
    pub(crate) fn signal(&self, signal: i32) {
        send_signal(self.launcher(), signal);
    }

    /// Waits for its end.
    pub(crate) fn finish(mut self) -> Outcome {
        self.gather()
    }

    fn gather(&mut self) -> Outcome {
        self.readers.take().unwrap().finish(self.child.take().unwrap())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// Sends a signal to a process of this test.
#[allow(unsafe_code, reason = "std can only kill its own children")]
pub(crate) fn send_signal(process: u32, signal: i32) {
    // SAFETY: kill has no memory preconditions.
    unsafe {
        libc::kill(process as libc::pid_t, signal);
    }
}

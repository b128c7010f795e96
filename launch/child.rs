//! One node as a process: started, watched, killed.

use crate::manifest::NodePlan;
use sidestep_bus::{DomainName, environment};
use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitStatus, Stdio};

/// What every node of a run is told.
#[derive(Debug, Clone)]
pub(crate) struct RunNames {
    /// The run's domain.
    pub(crate) domain: DomainName,
    /// The run's number.
    pub(crate) run: u64,
}

/// This program, also after its file was replaced.
const SELF: &str = "/proc/self/exe";

/// Tells a node of this program that it may not be paged out.
const LOCK_MEMORY: &str = "SIDESTEP_LOCK_MEMORY";

/// Keeps this process in memory, where the graph file asks and the system permits; else a line says so and it runs on.
pub(crate) fn stay_in_memory() {
    if std::env::var_os(LOCK_MEMORY).is_none() {
        return;
    }
    // SAFETY: mlockall has no memory preconditions.
    #[allow(unsafe_code, reason = "std cannot lock memory")]
    let locked = unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) == 0 };
    if !locked {
        let why = std::io::Error::last_os_error();
        crate::output::note(format!("locked memory not permitted ({why}); give the user LimitMEMLOCK"));
    }
}

/// Dies with the launcher, whatever ends it.
fn die_with_parent(command: &mut Command) {
    // SAFETY: prctl is async-signal-safe and touches nothing of the parent.
    #[allow(unsafe_code, reason = "a node must not outlive a killed launcher; std has no way to say so")]
    unsafe {
        command.pre_exec(|| match libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGKILL) {
            0 => Ok(()),
            _ => Err(std::io::Error::last_os_error()),
        });
    }
}

fn tell(command: &mut Command, names: &RunNames, node: &str, incarnation: u32) {
    command
        .env(environment::DOMAIN, &names.domain.prefix)
        .env(environment::ROOT, &names.domain.root)
        .env(environment::RUN, names.run.to_string())
        .env(environment::NODE, node)
        .env(environment::INCARNATION, incarnation.to_string())
        .env(environment::GRAPH, names.domain.root.join("graph.toml"))
        .env(environment::ROBOT, names.domain.root.join("robot.toml"))
        .env_remove(crate::notify::SOCKET)
        .env_remove(crate::notify::WATCHDOG)
        // The terminal's Ctrl-C is for the launcher, which stops the nodes in order.
        .process_group(0)
        .stdin(Stdio::null());
    die_with_parent(command);
}

/// Copies what a node says to the launcher's own output, a name before each line.
fn prefix_lines(name: &str, stream: impl Read + Send + 'static) {
    let name = name.to_owned();
    std::thread::spawn(move || {
        for line in BufReader::new(stream).lines().map_while(Result::ok) {
            crate::output::note(format!("{name:>8} | {line}"));
        }
    });
}

/// Starts a node.
///
/// # Errors
/// What the system says.
pub(crate) fn start(plan: &NodePlan, names: &RunNames, incarnation: u32) -> std::io::Result<Child> {
    let mut command = match plan.command.split_first() {
        Some((program, arguments)) => {
            let mut command = Command::new(program);
            command.args(arguments);
            command
        }
        None => {
            let mut command = Command::new(SELF);
            command.arg0(format!("sidestep-{}", plan.name)).args(["node", &plan.name]);
            command
        }
    };
    tell(&mut command, names, &plan.name, incarnation);
    if plan.lock_memory {
        command.env(LOCK_MEMORY, "1");
    }
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
    if let Some(stream) = child.stdout.take() {
        prefix_lines(&plan.name, stream);
    }
    if let Some(stream) = child.stderr.take() {
        prefix_lines(&plan.name, stream);
    }
    place(plan, child.id());
    Ok(child)
}

/// Starts the process that cleans up after the dead; it may hang, and can be killed.
///
/// # Errors
/// What the system says.
pub(crate) fn start_sweeper(names: &RunNames) -> std::io::Result<Child> {
    let mut command = Command::new(SELF);
    command.arg("sweep");
    tell(&mut command, names, "sweeper", 0);
    command.stdout(Stdio::null()).stderr(Stdio::null()).spawn()
}

/// Cores and priority, where the graph file asks and the system permits; else a line says so and the node runs on.
fn place(plan: &NodePlan, process: u32) {
    let process = process as libc::pid_t;
    if !plan.cpus.is_empty() && !set_affinity(process, &plan.cpus) {
        let why = std::io::Error::last_os_error();
        crate::output::note(format!(
            "{:>8} | cores {:?} not permitted ({why}); runs on all",
            plan.name, plan.cpus
        ));
    }
    if plan.nice > 0 {
        give_way(process, plan.nice);
    }
    if plan.priority > 0 && !set_priority(process, plan.priority) {
        let why = std::io::Error::last_os_error();
        let remedy = "give the user LimitRTPRIO";
        crate::output::note(format!(
            "{:>8} | real-time priority {} not permitted ({why}); {remedy}",
            plan.name, plan.priority
        ));
    }
}

#[allow(unsafe_code, reason = "std offers no affinity")]
fn set_affinity(process: libc::pid_t, cpus: &[usize]) -> bool {
    // SAFETY: a zeroed cpu_set_t is an empty set, and CPU_SET checks its bounds.
    unsafe {
        let mut set: libc::cpu_set_t = std::mem::zeroed();
        for &cpu in cpus.iter().filter(|&&cpu| cpu < libc::CPU_SETSIZE as usize) {
            libc::CPU_SET(cpu, &mut set);
        }
        libc::sched_setaffinity(process, size_of::<libc::cpu_set_t>(), &raw const set) == 0
    }
}

#[allow(unsafe_code, reason = "std offers no scheduling policy")]
fn set_priority(process: libc::pid_t, priority: u8) -> bool {
    let parameter = libc::sched_param { sched_priority: i32::from(priority) };
    // SAFETY: `parameter` outlives the call.
    unsafe { libc::sched_setscheduler(process, libc::SCHED_FIFO, &raw const parameter) == 0 }
}

/// Lets others go first; process 0 is this one.
#[allow(unsafe_code, reason = "std offers no nice value")]
pub(crate) fn give_way(process: libc::pid_t, nice: u8) {
    // SAFETY: setpriority has no memory preconditions; giving way is permitted to everybody.
    unsafe {
        libc::setpriority(libc::PRIO_PROCESS, process as libc::id_t, i32::from(nice.min(19)));
    }
}

/// Sends a signal to a process that this launcher started; it is not yet waited for, so that its number belongs to it.
pub(crate) fn signal(child: &Child, signal: i32) {
    signal_process(child.id() as libc::pid_t, signal);
}

/// Sends a signal to a process of this user.
pub(crate) fn signal_process(process: libc::pid_t, signal: i32) {
    // SAFETY: kill has no memory preconditions.
    #[allow(unsafe_code, reason = "std can only kill its own children, and a node must be asked first")]
    unsafe {
        libc::kill(process, signal);
    }
}

/// How a node ended, in words.
pub(crate) fn ending(status: ExitStatus) -> String {
    use std::os::unix::process::ExitStatusExt;
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("exit {code}"),
        (None, Some(signal)) => format!("signal {signal}"),
        (None, None) => "unknown".to_owned(),
    }
}

/// Processor seconds and megabytes (PSS) of a process.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Usage {
    /// `[s]` processor time, user and system.
    pub(crate) cpu_s: f64,
    /// `[MB]` proportional set size.
    pub(crate) pss_mb: f64,
}

/// What a process has used; zeros when it is gone.
pub(crate) fn usage(process: u32) -> Usage {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    // Fields 14 and 15, counted behind the name in brackets, in hundredths of a second.
    let after_name = stat.rsplit_once(')').map_or("", |(_, rest)| rest);
    let ticks: f64 =
        after_name.split_whitespace().skip(11).take(2).filter_map(|field| field.parse::<f64>().ok()).sum();
    let smaps = std::fs::read_to_string(format!("/proc/{process}/smaps_rollup")).unwrap_or_default();
    let pss_kb = smaps.lines().find_map(|line| line.strip_prefix("Pss:"));
    let pss_kb = pss_kb.and_then(|rest| rest.trim().trim_end_matches("kB").trim().parse::<f64>().ok());
    Usage { cpu_s: ticks / 100.0, pss_mb: pss_kb.unwrap_or(0.0) / 1024.0 }
}

//! Every error a user can cause on the command line: what was found, what is needed, what to do, and the exit code.

use crate::harness::{Folder, run};

/// Runs a command that must fail with this code and say all of this.
pub(crate) fn refused(arguments: &[&str], code: i32, says: &[&str]) {
    let outcome = run(arguments);
    assert_eq!(outcome.code, code, "{arguments:?}: {}{}", outcome.out, outcome.err);
    for text in says {
        assert!(outcome.err.contains(text), "{arguments:?}: no \"{text}\" in:\n{}", outcome.err);
    }
}

fn graph() -> String {
    include_str!("../launch/graphs/sim.toml").to_owned()
}

#[test]
fn the_shipped_graphs_are_valid() {
    for name in ["sim", "robot", "play"] {
        let outcome = run(&["check", name]);
        assert_eq!(outcome.code, 0, "{name}: {}", outcome.err);
        assert!(outcome.out.contains("mapper, "), "{}", outcome.out);
    }
}

#[test]
fn an_unknown_key_is_shown_with_line_column_and_what_is_allowed() {
    let folder = Folder::new("unknown-key");
    let path =
        folder.write("graph.toml", &graph().replace("lead = \"policy\"", "lead = \"policy\"\ncolour = 3"));
    refused(
        &["check", &path],
        2,
        &["line", "column 1", "colour = 3", "unknown field `colour`, expected one of"],
    );
}

#[test]
fn an_unknown_key_of_a_node_is_shown_with_line_and_column() {
    let folder = Folder::new("unknown-node-key");
    let path = folder.write("graph.toml", &graph().replace("people = ", "persons = "));
    refused(&["run", &path], 2, &["line", "column", "unknown field `persons`, expected one of", "`people`"]);
}

#[test]
fn a_wrong_type_is_shown_with_line_and_column() {
    let folder = Folder::new("wrong-type");
    let path = folder.write("graph.toml", &graph().replace("hang_ms = ", "hang_ms = \"soon\" #"));
    refused(&["check", &path], 2, &["line", "column", "invalid type: string \"soon\", expected u64"]);
}

#[test]
fn a_setting_is_checked_like_the_file() {
    refused(
        &["check", "sim", "--set", "sim.persons=3"],
        2,
        &["--set sim.persons=3", "unknown field `persons`"],
    );
    refused(&["check", "sim", "--set", "cellar.key=3"], 2, &["no such node in this graph", "NODE.KEY=VALUE"]);
    refused(&["check", "sim", "--set", "sim.people"], 2, &["no =", "NODE.KEY=VALUE"]);
}

#[test]
fn a_missing_graph_or_robot_names_the_built_in_ones() {
    refused(
        &["check", "nowhere.toml"],
        2,
        &["graph nowhere.toml", "give a path, or one of: sim, robot, play"],
    );
    refused(&["check", "sim", "--set", "robot=nobody"], 2, &["robot nobody", "loomo, jackal"]);
}

#[test]
fn a_robot_value_without_a_source_is_refused() {
    let folder = Folder::new("robot-source");
    let robot = include_str!("../launch/robots/loomo.toml")
        .replace("source = \"datasheet: ZR300\" }", "source = \"hearsay\" }");
    let path = folder.write("robot.toml", &robot);
    refused(
        &["check", "sim", "--set", &format!("robot={path}")],
        2,
        &["source is \"hearsay\"", "measured, datasheet"],
    );
}

#[test]
fn a_lead_that_is_none_is_refused() {
    refused(
        &["--lead", "nobody", "--for", "1s"],
        2,
        &["unknown variant `nobody`", "`policy`, `expert`, `solved`"],
    );
}

#[test]
fn a_duration_without_a_unit_is_refused() {
    refused(&["run", "sim", "--for", "30"], 2, &["30 is no duration", "such as 30s"]);
}

#[test]
fn a_topic_that_is_none_is_refused() {
    refused(&["topic", "hz", "smell"], 2, &["no topic is named smell", "sidestep topic list"]);
}

#[test]
fn a_node_started_by_hand_says_who_starts_nodes() {
    refused(&["node", "mapper"], 2, &["SIDESTEP_DOMAIN is not set", "sidestep run"]);
    refused(&["node", "cellar"], 2, &["no node is named cellar", "mapper"]);
}

#[test]
fn layouts_are_printed_for_c_and_python() {
    let c = run(&["interface", "--c"]);
    assert!(c.out.contains("static_assert(sizeof(LocalMap) == 2392"), "{}", &c.out[..2000]);
    let python = run(&["interface", "--python"]);
    assert!(python.out.contains("return \"sidestep/LocalMap/1\""), "{}", &python.out[..2000]);
}

#[test]
fn a_recording_that_is_none_is_refused() {
    refused(
        &["info", "nowhere.mcap"],
        3,
        &["recording nowhere.mcap", "No such file", "give the path of an .mcap"],
    );
    refused(&["play", "nowhere.mcap"], 3, &["recording nowhere.mcap", "No such file"]);
    refused(&["info", "Cargo.toml"], 3, &["recording Cargo.toml", "not an MCAP file"]);
    refused(&["latency", "nowhere.mcap"], 3, &["recording nowhere.mcap"]);
    refused(&["import", "nowhere", "out.mcap"], 3, &["nowhere"]);
}

#[test]
fn a_missing_world_or_model_ends_the_run_with_its_path_and_remedy() {
    let _alone = crate::harness::Alone::wait();
    refused(
        &["run", "sim", "--set", "sim.world=nowhere.toml"],
        2,
        &["nowhere.toml", "sim was given up: exit 2"],
    );
    refused(
        &["run", "sim", "--model", "nowhere.onnx"],
        2,
        &["model nowhere.onnx: cannot be read", "name a file written by"],
    );
    refused(&["run", "sim", "--model", "Cargo.toml"], 2, &["Cargo.toml", "policy was given up: exit 2"]);
}

#[test]
fn what_a_node_would_refuse_is_refused_before_anything_starts() {
    for (arguments, needed) in [
        (&["check", "sim", "--set", "sim.people=99"][..], "people is 99, needed: 0 to 16"),
        (
            &["check", "sim", "--set", "sim.lockstep_rate_most=0"],
            "lockstep_rate_most is 0, needed: 0.1 to 1000",
        ),
        (&["check", "robot", "--set", "lead=nobody"], "unknown variant `nobody`"),
        (&["check", "play", "--set", "player.topics=[\"command\"]"], "needed: a topic of the driver"),
        (&["run", "play", "--set", "player.rate=0.0"], "player.rate is 0, needed"),
    ] {
        refused(arguments, 2, &[needed]);
    }
}

#[test]
fn a_graph_that_lacks_its_lead_or_its_driver_is_refused() {
    let folder = Folder::new("lacking");
    let shipped = include_str!("../launch/graphs/robot.toml");
    let (without_driver, _) = shipped.split_once("# The driver publishes").unwrap();
    let waiting =
        folder.write("waiting.toml", &without_driver.replace("time = \"real\"", "time = \"lockstep\""));
    refused(
        &["check", &waiting],
        2,
        &["lockstep", "no driver", "needed: one of sim, player and [external.driver]"],
    );
    let (before, rest) = shipped.split_once("[nodes.policy]").unwrap();
    let (_, after) = rest.split_once("[nodes.expert]").unwrap();
    let leaderless = folder.write("leaderless.toml", &format!("{before}[nodes.expert]{after}"));
    refused(
        &["check", &leaderless],
        2,
        &["lead is policy, and there is no node policy", "name another lead"],
    );
}

#[test]
fn tools_without_a_run_say_how_to_start_one() {
    // A folder of its own, so that no other test's run is found; short, since the sockets of runs would lie in it.
    let folder = Folder(std::env::temp_dir().join(format!("n{}", std::process::id())));
    std::fs::create_dir_all(&folder.0).unwrap();
    let mut command = crate::harness::sidestep(&["topic", "hz", "command"]);
    command
        .env("XDG_RUNTIME_DIR", &folder.0)
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped());
    let outcome = crate::harness::finish(command.spawn().unwrap());
    assert_eq!(outcome.code, 3, "{}", outcome.out);
    assert!(outcome.err.contains("no run is alive; start one with `sidestep run`"), "{}", outcome.err);
}

//! The graph files say what the nodes ship: whoever reads a graph file reads the values that were measured.

use serde::de::DeserializeOwned;
use std::fmt::Debug;

fn config<C: DeserializeOwned>(graph: &str, node: &str) -> C {
    let graph: toml::Table = graph.parse().unwrap();
    graph["nodes"][node]["config"].clone().try_into().unwrap()
}

fn same<C: DeserializeOwned + PartialEq + Debug>(node: &str, shipped: &C) {
    let graphs = [
        include_str!("../launch/graphs/sim.toml"),
        include_str!("../launch/graphs/robot.toml"),
        include_str!("../launch/graphs/play.toml"),
    ];
    for graph in graphs {
        assert_eq!(&config::<C>(graph, node), shipped, "{node}");
    }
}

#[test]
fn every_graph_has_the_shipped_configuration_of_every_node() {
    same("mapper", &sidestep_mapper::Config::shipped());
    same("guard", &sidestep_guard::Config::STANDARD);
    same("goal", &sidestep_goal::Config::STANDARD);
    same("expert", &sidestep_expert::Config::STANDARD);
    same("arbiter", &sidestep_arbiter::Config::STANDARD);
}

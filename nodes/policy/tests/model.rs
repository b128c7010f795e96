//! The promises of the loader, on a network with made-up numbers.
#![allow(clippy::unwrap_used, clippy::float_cmp, reason = "a test fails by panicking")]

use sidestep_msgs::{LOCAL_CELLS, LocalGoal, LocalMap, Proposal, Robot, Status, Twist};
use sidestep_policy::*;

fn robot() -> Robot {
    Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml")).unwrap()
}

/// A short pseudo-random sequence in [-scale, scale).
fn numbers(count: usize, mut seed: u32, scale: f32) -> Vec<f32> {
    let mut next = || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        ((seed >> 8) as f32 / 8_388_608.0 - 1.0) * scale
    };
    (0..count).map(|_| next()).collect()
}

/// Convolutions that end in 4 x 5 cells, and what the dense layers behind them see.
const CONVOLVED: usize = 40 * 4 * 5 + DIRECT_FEATURES;

fn convolutions() -> Vec<ConvolutionLayer> {
    let layer = |inputs: usize, outputs: usize, stride, seed| ConvolutionLayer {
        inputs,
        outputs,
        stride,
        weight: numbers(outputs * inputs * 9, seed, 0.2),
        bias: numbers(outputs, seed + 1, 0.1),
    };
    vec![layer(CROP_PLANES, 32, 1, 40), layer(32, 20, 2, 50), layer(20, 40, 2, 60)]
}

fn network(rounds: usize, convolutions: Vec<ConvolutionLayer>) -> Network {
    let kernels = |seed, scale| -> Vec<[f32; 9]> {
        numbers(90, seed, scale).chunks_exact(9).map(|k| std::array::from_fn(|i| k[i])).collect()
    };
    let layer = |inputs: usize, outputs: usize, seed| DenseLayer {
        inputs,
        outputs,
        weight: numbers(inputs * outputs, seed, 0.08),
        bias: numbers(outputs, seed + 1, 0.1),
    };
    let features =
        if convolutions.is_empty() { CROP_PLANES * CROP_CELLS + DIRECT_FEATURES } else { CONVOLVED };
    Network {
        lambda: 1.0,
        rounds,
        reward: kernels(1, 0.5),
        reward_bias: numbers(10, 2, 0.1),
        value: kernels(3, 0.2),
        dense: vec![layer(features, 128, 10), layer(128, 64, 20), layer(64, HEAD_OUTPUTS, 30)],
        convolutions,
    }
}

fn contract(rounds: usize) -> Contract {
    let bytes: Vec<u8> = numbers(LOCAL_CELLS, 77, 1.0).iter().map(|x| ((x + 1.0) * 127.0) as u8).collect();
    let golden = Golden {
        planning_cost: bytes.try_into().unwrap(),
        goal_cell: 100,
        velocity: Twist::new(0.4, -0.2),
        command: [0.0; 2],
        doubt: [0.0; 2],
    };
    Contract {
        rounds,
        robot: "loomo".into(),
        robot_hash: robot().hash(),
        motion_hash: robot().motion_hash(),
        window_s: 0.3,
        dataset_hash: 1,
        samples_seen: 0,
        golden,
    }
}

fn model(rounds: usize) -> Vec<u8> {
    exported(rounds, convolutions())
}

fn exported(rounds: usize, convolutions: Vec<ConvolutionLayer>) -> Vec<u8> {
    let (network, mut contract) = (network(rounds, convolutions), contract(rounds));
    contract.golden = record_golden(&to_onnx(&network, &contract), contract.golden).unwrap();
    to_onnx(&network, &contract)
}

fn refusal(bytes: &[u8]) -> String {
    Policy::load(bytes, "test.onnx", &robot()).unwrap_err().to_string()
}

#[test]
fn the_fused_operators_compute_what_plain_tract_computes() {
    for (rounds, convolutions) in [(1, convolutions()), (5, vec![]), (36, convolutions())] {
        let bytes = exported(rounds, convolutions);
        let mut fused = Policy::load(&bytes, "fused", &robot()).unwrap();
        let mut plain = Policy::load_plain(&bytes, "plain", &robot()).unwrap();
        assert_eq!(fused.warning(), None);
        for seed in 0..8 {
            let map: Vec<u8> =
                numbers(LOCAL_CELLS, seed, 1.0).iter().map(|x| ((x + 1.0) * 127.0) as u8).collect();
            let map = map.try_into().unwrap();
            let twist = Twist::new(0.1 * seed as f32, 0.3);
            let (a, b) =
                (fused.infer(&map, 90 * seed as usize, twist), plain.infer(&map, 90 * seed as usize, twist));
            let (a, b) = (a.unwrap(), b.unwrap());
            let pairs = a.command.iter().zip(b.command).chain(a.doubt.iter().zip(b.doubt));
            for (a, b) in pairs {
                assert!((a - b).abs() < 1e-5, "rounds {rounds}: {a} {b}");
            }
        }
    }
}

#[test]
fn unequal_rounds_are_not_fused_but_run_with_a_warning() {
    use prost::Message;
    let mut graph = tract_onnx::pb::ModelProto::decode(model(4).as_slice()).unwrap();
    let nodes = &mut graph.graph.as_mut().unwrap();
    let mut other = nodes.initializer.iter().find(|t| t.name == "vi/weight").unwrap().clone();
    other.name = "vi/weight2".into();
    nodes.initializer.push(other);
    nodes.node.iter_mut().find(|n| n.name == "vi/2/expected").unwrap().input[1] = "vi/weight2".into();
    let policy = Policy::load(&graph.encode_to_vec(), "odd.onnx", &robot()).unwrap();
    let warning = policy.warning().unwrap();
    assert!(warning.contains("does not share"), "{warning}");
}

/// Changes one thing at a time that the fused convolutions cannot do, or that somebody else wants to see.
#[test]
fn other_convolutions_are_not_fused_but_run_with_a_warning() {
    use prost::Message;
    type Graph = tract_onnx::pb::GraphProto;
    let warn = |edit: &dyn Fn(&mut Graph)| {
        let mut model = tract_onnx::pb::ModelProto::decode(model(2).as_slice()).unwrap();
        edit(model.graph.as_mut().unwrap());
        let policy = Policy::load(&model.encode_to_vec(), "odd.onnx", &robot()).unwrap();
        policy.warning().unwrap().to_owned()
    };
    let node = |graph: &mut Graph, name: &str| graph.node.iter().position(|n| n.name == name).unwrap();
    let rename = |graph: &mut Graph, from: &str, to: &str| {
        let names = graph.node.iter_mut().flat_map(|n| n.input.iter_mut().chain(&mut n.output));
        names.filter(|name| *name == from).for_each(|name| *name = to.into());
    };
    let text = warn(&|graph| rename(graph, "convolved", "folded"));
    assert!(text.contains("no node makes \"convolved\""), "{text}");
    let text = warn(&|graph| {
        // The same numbers by another way: negative twice.
        let relu = node(graph, "convolution/0/bent");
        let mut minus = graph.node[relu].clone();
        (minus.op_type, minus.name, minus.output[0]) = ("Neg".into(), "minus".into(), "minus".into());
        let mut plus = minus.clone();
        (plus.name, plus.input[0], plus.output[0]) = ("plus".into(), "minus".into(), "plus".into());
        graph.node[relu].input[0] = "plus".into();
        graph.node.splice(relu..relu, [minus, plus]);
    });
    assert!(text.contains("\"plus\" is made by Neg with 1 inputs, not by Conv with 3"), "{text}");
    let text = warn(&|graph| {
        let conv = node(graph, "convolution/1/sum");
        graph.node[conv].attribute.push(tract_onnx::pb::AttributeProto {
            name: "auto_pad".into(),
            r#type: tract_onnx::pb::attribute_proto::AttributeType::String as i32,
            s: b"NOTSET".to_vec(),
            ..Default::default()
        });
    });
    assert!(text.contains("Conv \"convolution/1/sum\" has auto_pad"), "{text}");
    let text = warn(&|graph| {
        let relu = node(graph, "convolution/0/bent");
        let mut reader = graph.node[relu].clone();
        (reader.name, reader.input[0], reader.output[0]) =
            ("reader".into(), "convolution/0/bent".into(), "read".into());
        graph.node.push(reader);
    });
    assert!(text.contains("\"convolution/0/bent\" is used outside its block"), "{text}");
}

#[test]
fn a_model_for_another_robot_is_refused_with_both_hashes() {
    let mut robot = robot();
    robot.limits.turn_rad_s = 2.0;
    let text = Policy::load(&model(3), "test.onnx", &robot).unwrap_err().to_string();
    assert!(
        text.contains("motion_hash") && text.contains(&format!("{:016x}", robot.motion_hash())),
        "{text}"
    );
}

#[test]
fn a_model_outlives_the_identification_of_its_base() {
    let mut robot = robot();
    robot.actuator.lag_s *= 2.0;
    robot.start.disc_m += 0.1;
    Policy::load(&model(3), "test.onnx", &robot).unwrap();
}

#[test]
fn bytes_that_are_no_model_are_refused_and_never_panic() {
    let good = model(3);
    assert!(refusal(b"hello").contains("test.onnx"));
    assert!(refusal(&[]).contains("sidestep.contract is missing"));
    for cut in (0..good.len()).step_by(good.len() / 37) {
        refusal(&good[..cut]);
    }
    let mut seed = 1_u32;
    for _ in 0..60 {
        let mut damaged = good.clone();
        for _ in 0..20 {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let place = (seed >> 4) as usize % damaged.len();
            damaged[place] = (seed >> 16) as u8;
        }
        let _ = Policy::load(&damaged, "damaged.onnx", &robot());
    }
}

#[test]
fn a_wrong_answer_to_the_self_test_is_refused() {
    let mut contract = contract(3);
    contract.golden = record_golden(&to_onnx(&network(3, vec![]), &contract), contract.golden).unwrap();
    contract.golden.command[1] += 2e-4;
    let text = refusal(&to_onnx(&network(3, vec![]), &contract));
    assert!(text.contains("self-test"), "{text}");
}

#[test]
fn rounds_in_metadata_and_graph_must_agree() {
    let mut contract = contract(3);
    contract.golden = record_golden(&to_onnx(&network(3, vec![]), &contract), contract.golden).unwrap();
    contract.rounds = 36;
    let text = refusal(&to_onnx(&network(3, vec![]), &contract));
    assert!(text.contains("3 in the graph") && text.contains("36 as metadata"), "{text}");
}

#[test]
fn a_wrong_shape_or_name_is_refused_with_what_is_needed() {
    use prost::Message;
    let change = |edit: &dyn Fn(&mut tract_onnx::pb::GraphProto)| {
        let mut model = tract_onnx::pb::ModelProto::decode(model(3).as_slice()).unwrap();
        edit(model.graph.as_mut().unwrap());
        refusal(&model.encode_to_vec())
    };
    let text = change(&|graph| graph.input[0].name = "cost_map".into());
    assert!(
        text.contains("inputs is cost_map, goal, velocity, needed: planning_cost, goal, velocity"),
        "{text}"
    );
    let text = change(&|graph| graph.input[2] = graph.input[1].clone());
    assert!(text.contains("inputs"), "{text}");
    let text = change(&|graph| {
        let shape = graph.output[0].r#type.clone();
        graph.input[0].r#type = shape;
    });
    assert!(text.contains("shape of planning_cost is float [1, 2], needed: float [1, 1, 28, 28]"), "{text}");
    let text = change(&|graph| graph.node[0].op_type = "SidestepHead".into());
    assert!(text.contains("standard ONNX"), "{text}");
}

#[test]
fn inputs_are_found_by_name_in_any_order() {
    use prost::Message;
    let bytes = model(3);
    let mut turned = tract_onnx::pb::ModelProto::decode(bytes.as_slice()).unwrap();
    let graph = turned.graph.as_mut().unwrap();
    graph.input.reverse();
    graph.output.reverse();
    Policy::load(&turned.encode_to_vec(), "turned.onnx", &robot()).unwrap();
}

fn frame() -> (LocalMap, LocalGoal, Proposal) {
    (LocalMap::default(), LocalGoal::default(), Proposal::default())
}

#[test]
fn a_proposal_lies_in_the_window_whatever_the_network_says() {
    let mut policy = Policy::load(&model(3), "test.onnx", &robot()).unwrap();
    let (map, mut goal, mut out) = frame();
    for v in [-3.0, 0.0, 0.7, 40.0] {
        goal.twist = Twist::new(v, 0.5);
        assert_eq!(policy.propose(&map, &goal, Status::Ok, &mut out), Status::Ok);
        let limits = robot().limits;
        assert_eq!(out.twist, sidestep_msgs::clamp_to_window(out.twist, goal.twist, &limits));
        assert!(out.doubt_v_m_s > 0.0 && out.doubt_w_rad_s > 0.0);
    }
}

#[test]
fn without_goal_map_or_sense_the_policy_stops_and_says_why() {
    let mut policy = Policy::load(&model(3), "test.onnx", &robot()).unwrap();
    let (mut map, mut goal, mut out) = frame();
    for status in [Status::NoMap, Status::NoGoal, Status::Arrived, Status::Hold, Status::Lost, Status::Fault]
    {
        assert_eq!(policy.propose(&map, &goal, status, &mut out), status);
        assert_eq!(out.twist, Twist::STOP);
    }
    map.capture_ns = 5;
    assert_eq!(policy.propose(&map, &goal, Status::Ok, &mut out), Status::NoMap);
    map.capture_ns = 0;
    goal.cell = 784;
    assert_eq!(policy.propose(&map, &goal, Status::Ok, &mut out), Status::Fault);
    goal.cell = 0;
    for twist in [Twist::new(f32::NAN, 0.0), Twist::new(0.0, f32::INFINITY)] {
        goal.twist = twist;
        assert_eq!(policy.propose(&map, &goal, Status::Ok, &mut out), Status::Fault);
        assert_eq!(out.twist, Twist::STOP);
    }
}

//! Writes a network as one ONNX file of standard operators (opset 13), which any runtime can check.

use crate::contract::{Contract, INPUTS, OUTPUTS};
use crate::network::{
    CROP_CELLS, CROP_COL, CROP_COLS, CROP_ROW, CROP_ROWS, DIRECT_FEATURES, GOAL_FEATURES, LOG_DOUBT_RANGE,
    Network, ROBOT_COL, ROBOT_ROW, goal_feature_table,
};
use prost::Message;
use sidestep_msgs::{LOCAL_CELLS, LOCAL_SIDE};
use tract_onnx::pb::{
    AttributeProto, GraphProto, ModelProto, NodeProto, OperatorSetIdProto, StringStringEntryProto,
    TensorProto, TensorShapeProto, TypeProto, ValueInfoProto, attribute_proto::AttributeType,
    tensor_shape_proto, type_proto,
};

const FLOAT: i32 = 1;
const INT64: i32 = 7;
/// Operator set of the file: the last in which ReduceMax takes its axes as attribute.
const OPSET: i64 = 13;
/// Version of the file format that goes with that operator set.
const IR_VERSION: i64 = 8;

/// The bytes of the ONNX file.
#[must_use]
pub fn to_onnx(network: &Network, contract: &Contract) -> Vec<u8> {
    let mut writer = Writer::default();
    writer.value_iteration(network);
    writer.features(network);
    writer.head(network);
    let info = |(name, shape): &(&str, &[usize])| value_info(name, shape);
    let graph = GraphProto {
        name: "policy".into(),
        node: writer.nodes,
        initializer: writer.constants,
        input: INPUTS.iter().map(info).collect(),
        output: OUTPUTS.iter().map(info).collect(),
        ..GraphProto::default()
    };
    let entry = |(key, value)| StringStringEntryProto { key, value };
    let model = ModelProto {
        ir_version: IR_VERSION,
        opset_import: vec![OperatorSetIdProto { domain: String::new(), version: OPSET }],
        producer_name: "sidestep".into(),
        producer_version: env!("CARGO_PKG_VERSION").into(),
        graph: Some(graph),
        metadata_props: contract.to_entries().into_iter().map(entry).collect(),
        ..ModelProto::default()
    };
    model.encode_to_vec()
}

#[derive(Default)]
struct Writer {
    nodes: Vec<NodeProto>,
    constants: Vec<TensorProto>,
}

impl Writer {
    fn node(&mut self, kind: &str, inputs: &[&str], output: &str, attribute: Vec<AttributeProto>) {
        self.nodes.push(NodeProto {
            op_type: kind.into(),
            name: output.into(),
            input: inputs.iter().map(|s| (*s).to_owned()).collect(),
            output: vec![output.into()],
            attribute,
            ..NodeProto::default()
        });
    }

    fn floats(&mut self, name: &str, dims: &[usize], values: impl IntoIterator<Item = f32>) {
        let raw_data = values.into_iter().flat_map(f32::to_le_bytes).collect();
        self.constant(name, dims, FLOAT, raw_data);
    }

    fn integers(&mut self, name: &str, values: &[i64]) {
        let raw_data = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.constant(name, &[values.len()], INT64, raw_data);
    }

    fn constant(&mut self, name: &str, dims: &[usize], data_type: i32, raw_data: Vec<u8>) {
        let dims = dims.iter().map(|d| *d as i64).collect();
        self.constants.push(TensorProto {
            name: name.into(),
            dims,
            data_type,
            raw_data,
            ..TensorProto::default()
        });
    }

    /// m_r, and V after K rounds.
    fn value_iteration(&mut self, network: &Network) {
        let channels = network.reward.len();
        let border = || vec![integers("kernel_shape", &[3, 3]), integers("pads", &[1, 1, 1, 1])];
        self.floats("lambda", &[], [network.lambda]);
        self.floats("vi/reward/weight", &[channels, 1, 3, 3], network.reward.iter().flatten().copied());
        self.floats("vi/reward/bias", &[channels], network.reward_bias.iter().copied());
        self.floats("vi/weight", &[channels, 1, 3, 3], network.value.iter().flatten().copied());
        self.floats("vi/start", &[1, 1, LOCAL_SIDE, LOCAL_SIDE], [0.0; LOCAL_CELLS]);
        self.node("Mul", &["goal", "lambda"], "goal_reward", vec![]);
        self.node("Sub", &["goal_reward", "planning_cost"], "reward_map", vec![]);
        self.node("Conv", &["reward_map", "vi/reward/weight", "vi/reward/bias"], "vi/reward", border());
        let mut value = "vi/start".to_owned();
        for round in 1..=network.rounds {
            let name = |part: &str| format!("vi/{round}/{part}");
            let next = if round == network.rounds { "vi/value".into() } else { name("value") };
            self.node("Conv", &[&value, "vi/weight"], &name("expected"), border());
            self.node("Add", &["vi/reward", &name("expected")], &name("action_values"), vec![]);
            let over_channels = vec![integers("axes", &[1]), integer("keepdims", 1)];
            self.node("ReduceMax", &[&name("action_values")], &next, over_channels);
            value = next;
        }
    }

    /// The crop of V and m_r round the robot, u', and where the goal is.
    fn features(&mut self, network: &Network) {
        let crop = |from: usize, count: usize| (from as i64, (from + count) as i64);
        let (top, bottom) = crop(CROP_ROW, CROP_ROWS);
        let (left, right) = crop(CROP_COL, CROP_COLS);
        let (ahead, behind) = crop(ROBOT_ROW, 2);
        let (port, starboard) = crop(ROBOT_COL, 2);
        self.integers("axes", &[2, 3]);
        self.integers("crop/start", &[top, left]);
        self.integers("crop/end", &[bottom, right]);
        self.integers("robot/start", &[ahead, port]);
        self.integers("robot/end", &[behind, starboard]);
        self.integers("goal/flat", &[1, LOCAL_CELLS as i64]);
        self.floats("goal/table", &[LOCAL_CELLS, GOAL_FEATURES], goal_feature_table());
        self.node("Slice", &["vi/value", "robot/start", "robot/end", "axes"], "value_robot_cells", vec![]);
        let mean = vec![integers("axes", &[2, 3]), integer("keepdims", 1)];
        self.node("ReduceMean", &["value_robot_cells"], "value_robot", mean);
        self.node("Slice", &["vi/value", "crop/start", "crop/end", "axes"], "value_crop", vec![]);
        self.node("Sub", &["value_crop", "value_robot"], "value_relative", vec![]);
        self.node("Slice", &["reward_map", "crop/start", "crop/end", "axes"], "reward_crop", vec![]);
        self.node("Reshape", &["goal", "goal/flat"], "goal_cells", vec![]);
        self.node("MatMul", &["goal_cells", "goal/table"], "goal_features", vec![]);
        let planes: &[&str] = if network.convolutions.is_empty() {
            self.integers("crop/flat", &[1, CROP_CELLS as i64]);
            self.node("Reshape", &["value_relative", "crop/flat"], "value_features", vec![]);
            self.node("Reshape", &["reward_crop", "crop/flat"], "reward_features", vec![]);
            &["value_features", "reward_features"]
        } else {
            self.convolutions(network);
            self.integers("convolved/flat", &[1, (network.features() - DIRECT_FEATURES) as i64]);
            self.node("Reshape", &["convolved", "convolved/flat"], "plane_features", vec![]);
            &["plane_features"]
        };
        let parts = [planes, &["velocity", "goal_features"]].concat();
        self.node("Concat", &parts, "features", vec![integer("axis", 1)]);
        debug_assert_eq!(network.dense[0].inputs, network.features());
    }

    /// From the two crops to `convolved`.
    fn convolutions(&mut self, network: &Network) {
        self.node("Concat", &["value_relative", "reward_crop"], "planes", vec![integer("axis", 1)]);
        let mut current = "planes".to_owned();
        for (index, layer) in network.convolutions.iter().enumerate() {
            let name = |part: &str| format!("convolution/{index}/{part}");
            let (stride, dims) = (layer.stride as i64, [layer.outputs, layer.inputs, 3, 3]);
            self.floats(&name("weight"), &dims, layer.weight.iter().copied());
            self.floats(&name("bias"), &[layer.outputs], layer.bias.iter().copied());
            let attribute = vec![
                integers("kernel_shape", &[3, 3]),
                integers("pads", &[1, 1, 1, 1]),
                integers("strides", &[stride, stride]),
            ];
            self.node("Conv", &[&current, &name("weight"), &name("bias")], &name("sum"), attribute);
            let last = index + 1 == network.convolutions.len();
            current = if last { "convolved".into() } else { name("bent") };
            self.node("Relu", &[&name("sum")], &current, vec![]);
        }
    }

    /// Dense layers, command and doubt.
    fn head(&mut self, network: &Network) {
        let mut current = "features".to_owned();
        for (index, layer) in network.dense.iter().enumerate() {
            let name = |part: &str| format!("dense/{index}/{part}");
            self.floats(&name("weight"), &[layer.inputs, layer.outputs], layer.weight.iter().copied());
            self.floats(&name("bias"), &[layer.outputs], layer.bias.iter().copied());
            self.node("Gemm", &[&current, &name("weight"), &name("bias")], &name("sum"), vec![]);
            current = name("sum");
            if index + 1 < network.dense.len() {
                self.node("Relu", &[&current], &name("bent"), vec![]);
                current = name("bent");
            }
        }
        for (name, value) in [("column/0", 0), ("column/2", 2), ("column/4", 4), ("column/axis", 1)] {
            self.integers(name, &[value]);
        }
        self.floats("doubt/least", &[], [LOG_DOUBT_RANGE.0]);
        self.floats("doubt/most", &[], [LOG_DOUBT_RANGE.1]);
        self.node("Slice", &[&current, "column/0", "column/2", "column/axis"], "change", vec![]);
        self.node("Slice", &[&current, "column/2", "column/4", "column/axis"], "log_doubt", vec![]);
        self.node("Add", &["change", "velocity"], "command", vec![]);
        self.node("Clip", &["log_doubt", "doubt/least", "doubt/most"], "log_doubt_within", vec![]);
        self.node("Exp", &["log_doubt_within"], "doubt", vec![]);
    }
}

fn integers(name: &str, values: &[i64]) -> AttributeProto {
    AttributeProto {
        name: name.into(),
        r#type: AttributeType::Ints as i32,
        ints: values.to_vec(),
        ..AttributeProto::default()
    }
}

fn integer(name: &str, value: i64) -> AttributeProto {
    AttributeProto {
        name: name.into(),
        r#type: AttributeType::Int as i32,
        i: value,
        ..AttributeProto::default()
    }
}

fn value_info(name: &str, shape: &[usize]) -> ValueInfoProto {
    let dimension = |d: &usize| tensor_shape_proto::Dimension {
        denotation: String::new(),
        value: Some(tensor_shape_proto::dimension::Value::DimValue(*d as i64)),
    };
    let tensor = type_proto::Tensor {
        elem_type: FLOAT,
        shape: Some(TensorShapeProto { dim: shape.iter().map(dimension).collect() }),
    };
    ValueInfoProto {
        name: name.into(),
        r#type: Some(TypeProto {
            denotation: String::new(),
            value: Some(type_proto::Value::TensorType(tensor)),
        }),
        doc_string: String::new(),
    }
}

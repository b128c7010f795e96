//! The policy: a model file checked against its contract, and one proposal per frame.

use crate::contract::{Contract, Golden, INPUTS, OUTPUTS, fingerprint, unfit};
use crate::error::ModelError;
use crate::graph::{View, replace};
use crate::operators::register;
use prost::Message;
use sidestep_msgs::{
    LOCAL_CELLS, Limits, LocalGoal, LocalMap, Proposal, Robot, Status, TRAJECTORY_MAX, Twist, clamp_to_window,
};
use std::collections::BTreeMap;
use std::sync::Arc;
use tract_onnx::pb::{GraphProto, ModelProto, ValueInfoProto, tensor_shape_proto::dimension, type_proto};
use tract_onnx::prelude::*;
use tract_onnx::tract_hir::internal::TypedSimpleState;

/// `[m/s, rad/s]` largest difference between the recorded and the computed answer of the self-test.
pub const TOLERANCE: f32 = 1e-4;

/// The model in the binary, for the robot of `launch/robots/loomo.toml`.
#[must_use]
pub fn embedded() -> &'static [u8] {
    include_bytes!("../model/loomo.onnx")
}

/// A network ready to run.
#[derive(Debug)]
pub struct Policy {
    state: TypedSimpleState,
    inputs: [Arc<Tensor>; 3],
    contract: Contract,
    limits: Limits,
    model_hash: u64,
    warning: Option<String>,
}

/// What the network answers, before any clamp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// `[m/s, rad/s]` the command.
    pub command: [f32; 2],
    /// `[m/s, rad/s]` the expected error of the command.
    pub doubt: [f32; 2],
}

impl Policy {
    /// Reads `onnx`, called `name` in messages, checks it and runs its self-test.
    ///
    /// # Errors
    /// [`ModelError`] with what was found, what is needed and what to do.
    pub fn load(onnx: &[u8], name: &str, robot: &Robot) -> Result<Self, ModelError> {
        Self::build(onnx, name, robot, true)
    }

    /// As [`Policy::load`], but without the fused operators: what any other runtime would compute. For comparison.
    ///
    /// # Errors
    /// As [`Policy::load`].
    pub fn load_plain(onnx: &[u8], name: &str, robot: &Robot) -> Result<Self, ModelError> {
        Self::build(onnx, name, robot, false)
    }

    fn build(onnx: &[u8], name: &str, robot: &Robot, fused: bool) -> Result<Self, ModelError> {
        let mut model = ModelProto::decode(onnx)
            .map_err(|error| ModelError::Format { model: name.into(), detail: error.to_string() })?;
        let entries: BTreeMap<String, String> =
            model.metadata_props.iter().map(|entry| (entry.key.clone(), entry.value.clone())).collect();
        let contract = Contract::from_entries(&entries, name, robot)?;
        let missing =
            || unfit(name, "graph", "missing", "present", "name a file written by `sidestep train`");
        let graph = model.graph.as_mut().ok_or_else(missing)?;
        check_interface(graph, name)?;
        check_operators(graph, name)?;
        order_interface(graph);
        let warning = if fused { fuse(graph, &contract, name)? } else { None };
        let mut policy = Self {
            state: prepare(&model, name)?,
            inputs: INPUTS.map(|(_, shape)| Arc::new(Tensor::zero::<f32>(shape).unwrap_or_default())),
            contract,
            limits: robot.limits,
            model_hash: fingerprint(onnx),
            warning,
        };
        policy.self_test(name)?;
        Ok(policy)
    }

    fn self_test(&mut self, name: &str) -> Result<(), ModelError> {
        let golden = self.contract.golden.clone();
        let answer = self
            .infer(&golden.planning_cost, golden.goal_cell, golden.velocity)
            .map_err(|detail| ModelError::Engine { model: name.into(), detail })?;
        let (found, needed) = (flat(&answer.command, &answer.doubt), flat(&golden.command, &golden.doubt));
        // NaN fails the comparison.
        let same = found.iter().zip(&needed).all(|(a, b)| (a - b).abs() <= TOLERANCE);
        if same {
            return Ok(());
        }
        Err(ModelError::SelfTest { model: name.into(), found, needed, tolerance: TOLERANCE })
    }

    /// Runs the network once.
    ///
    /// # Errors
    /// What the engine says; never seen after a successful load.
    pub fn infer(
        &mut self,
        planning_cost: &[u8; LOCAL_CELLS],
        goal_cell: usize,
        velocity: Twist,
    ) -> Result<Answer, String> {
        fill(&mut self.inputs[0], INPUTS[0].1, |cells| {
            for (cell, byte) in cells.iter_mut().zip(planning_cost) {
                *cell = f32::from(*byte) / 255.0;
            }
        })?;
        fill(&mut self.inputs[1], INPUTS[1].1, |cells| {
            cells.fill(0.0);
            if let Some(cell) = cells.get_mut(goal_cell) {
                *cell = 1.0;
            }
        })?;
        fill(&mut self.inputs[2], INPUTS[2].1, |pair| {
            pair.copy_from_slice(&[velocity.v_m_s, velocity.w_rad_s]);
        })?;
        let inputs = self.inputs.each_ref().map(|input| TValue::from_const(Arc::clone(input)));
        let outputs = self.state.run(inputs.into_iter().collect()).map_err(|error| error.to_string())?;
        let [command, doubt] = outputs.as_slice() else {
            return Err(format!("{} outputs instead of 2", outputs.len()));
        };
        Ok(Answer { command: pair(command)?, doubt: pair(doubt)? })
    }

    /// Proposes a velocity for one frame; without a goal to drive to, a stop and that status.
    pub fn propose(
        &mut self,
        map: &LocalMap,
        goal: &LocalGoal,
        goal_status: Status,
        out: &mut Proposal,
    ) -> Status {
        stop(goal.capture_ns, out);
        if goal_status != Status::Ok {
            return goal_status;
        }
        if map.capture_ns != goal.capture_ns {
            return Status::NoMap;
        }
        if !goal.twist.is_finite() || goal.cell as usize >= LOCAL_CELLS {
            return Status::Fault;
        }
        let Ok(answer) = self.infer(&map.planning_cost, goal.cell as usize, goal.twist) else {
            return Status::Fault;
        };
        if !flat(&answer.command, &answer.doubt).iter().all(|x| x.is_finite()) {
            return Status::Fault;
        }
        let wish = Twist::new(answer.command[0], answer.command[1]);
        out.twist = clamp_to_window(wish, goal.twist, &self.limits);
        [out.doubt_v_m_s, out.doubt_w_rad_s] = answer.doubt;
        Status::Ok
    }

    /// What the model says of itself.
    #[must_use]
    pub fn contract(&self) -> &Contract {
        &self.contract
    }

    /// Fingerprint of the model file.
    #[must_use]
    pub fn model_hash(&self) -> u64 {
        self.model_hash
    }

    /// Why the slow plain graph runs instead of the fused operators, if it does.
    #[must_use]
    pub fn warning(&self) -> Option<&str> {
        self.warning.as_deref()
    }
}

/// An answer that stands still.
fn stop(capture_ns: u64, out: &mut Proposal) {
    *out = Proposal {
        capture_ns,
        twist: Twist::STOP,
        doubt_v_m_s: f32::NAN,
        doubt_w_rad_s: f32::NAN,
        cost: f32::NAN,
        evaluated: 0,
        trajectory_count: 0,
        _pad: 0,
        trajectory_x_m: [0.0; TRAJECTORY_MAX],
        trajectory_y_m: [0.0; TRAJECTORY_MAX],
        trajectory_yaw_rad: [0.0; TRAJECTORY_MAX],
    };
}

fn flat(command: &[f32; 2], doubt: &[f32; 2]) -> [f32; 4] {
    [command[0], command[1], doubt[0], doubt[1]]
}

/// Fills an input in place; should the engine still hold it, a new one.
fn fill(input: &mut Arc<Tensor>, shape: &[usize], write: impl FnOnce(&mut [f32])) -> Result<(), String> {
    let explain = |error: TractError| error.to_string();
    if Arc::get_mut(input).is_none() {
        *input = Arc::new(Tensor::zero::<f32>(shape).map_err(explain)?);
    }
    let tensor = Arc::get_mut(input).ok_or("an input is shared")?;
    write(tensor.try_as_plain_ram_mut().map_err(explain)?.as_slice_mut().map_err(explain)?);
    Ok(())
}

fn pair(value: &TValue) -> Result<[f32; 2], String> {
    let view = value.try_as_plain_ram().map_err(|error| error.to_string())?;
    let slice: &[f32] = view.as_slice().map_err(|error| error.to_string())?;
    slice.try_into().map_err(|_| format!("{} numbers instead of 2", slice.len()))
}

/// Inputs and outputs by name, with type and shape.
fn check_interface(graph: &GraphProto, model: &str) -> Result<(), ModelError> {
    // Files of older writers list constants among the inputs too.
    let constant = |info: &&ValueInfoProto| !graph.initializer.iter().any(|tensor| tensor.name == info.name);
    let inputs: Vec<&ValueInfoProto> = graph.input.iter().filter(constant).collect();
    check_side("inputs", &inputs, &INPUTS, model)?;
    check_side("outputs", &graph.output.iter().collect::<Vec<_>>(), &OUTPUTS, model)
}

fn check_side(
    side: &str,
    found: &[&ValueInfoProto],
    needed: &[(&str, &[usize])],
    model: &str,
) -> Result<(), ModelError> {
    const REMEDY: &str = "export it with `sidestep train`";
    let names = |list: &mut dyn Iterator<Item = &str>| list.collect::<Vec<_>>().join(", ");
    let found_names = names(&mut found.iter().map(|info| info.name.as_str()));
    let needed_names = names(&mut needed.iter().map(|(name, _)| *name));
    for (name, shape) in needed {
        let Some(info) = found.iter().find(|info| info.name == *name) else {
            return Err(unfit(model, side, found_names, needed_names, REMEDY));
        };
        let text = describe(info);
        let wanted = format!("float {shape:?}");
        if text != wanted {
            return Err(unfit(model, format!("shape of {name}"), text, wanted, REMEDY));
        }
    }
    if found.len() != needed.len() {
        return Err(unfit(model, side, found_names, needed_names, REMEDY));
    }
    Ok(())
}

/// Type and shape of an input or output, as text.
fn describe(info: &ValueInfoProto) -> String {
    let Some(type_proto::Value::TensorType(tensor)) = info.r#type.as_ref().and_then(|t| t.value.as_ref())
    else {
        return "no tensor".into();
    };
    let size = |value: &Option<dimension::Value>| match value {
        Some(dimension::Value::DimValue(size)) => size.to_string(),
        _ => "?".into(),
    };
    let dims = tensor.shape.as_ref().map_or(&[][..], |shape| &shape.dim);
    let sizes: Vec<String> = dims.iter().map(|d| size(&d.value)).collect();
    let kind = if tensor.elem_type == 1 { "float".into() } else { format!("type {}", tensor.elem_type) };
    format!("{kind} [{}]", sizes.join(", "))
}

/// Standard operators only: nobody else may name the fused ones.
fn check_operators(graph: &GraphProto, model: &str) -> Result<(), ModelError> {
    let foreign = graph
        .node
        .iter()
        .find(|node| !matches!(node.domain.as_str(), "" | "ai.onnx") || node.op_type.starts_with("Sidestep"));
    foreign.map_or(Ok(()), |node| {
        let found = format!("{}.{}", node.domain, node.op_type);
        let remedy = "unroll it into standard operators";
        Err(unfit(model, format!("operator of \"{}\"", node.name), found, "standard ONNX", remedy))
    })
}

/// Puts inputs and outputs in the order of the contract; the engine knows them by position only.
fn order_interface(graph: &mut GraphProto) {
    let place = |order: &[(&str, &[usize])], name: &str| {
        order.iter().position(|(known, _)| *known == name).unwrap_or(order.len())
    };
    graph.input.sort_by_key(|info| place(&INPUTS, &info.name));
    graph.output.sort_by_key(|info| place(&OUTPUTS, &info.name));
}

/// Swaps in the fused operators; says why where it cannot.
fn fuse(graph: &mut GraphProto, contract: &Contract, model: &str) -> Result<Option<String>, ModelError> {
    let view = View::new(graph);
    let (value, convolutions, head) = (view.value_block(), view.convolution_block(), view.head_block());
    if let Ok(block) = &value
        && block.iteration.rounds != contract.rounds
    {
        let found = format!("{} in the graph", block.iteration.rounds);
        let needed = format!("{} as metadata sidestep.rounds says", contract.rounds);
        return Err(unfit(
            model,
            "rounds of value iteration",
            found,
            needed,
            "export it with `sidestep train`",
        ));
    }
    let reasons = [value.as_ref().err(), convolutions.as_ref().err(), head.as_ref().err()];
    let reasons: Vec<&str> = reasons.into_iter().flatten().map(String::as_str).collect();
    let warning = (!reasons.is_empty())
        .then(|| format!("model {model}: runs unfused and 30 times slower: {}", reasons.join("; ")));
    replace(graph, value.ok(), convolutions.ok().flatten(), head.ok());
    Ok(warning)
}

fn prepare(model: &ModelProto, name: &str) -> Result<TypedSimpleState, ModelError> {
    let explain = |error: TractError| ModelError::Engine { model: name.into(), detail: format!("{error:#}") };
    let mut engine = tract_onnx::onnx();
    register(&mut engine);
    let plan = engine
        .model_for_proto_model(model)
        .and_then(|graph| graph.into_optimized())
        .and_then(TypedSimplePlan::new)
        .map_err(explain)?;
    plan.spawn().map_err(explain)
}

/// Asks the network the question of a self-test and records its answer, for the exporter.
///
/// # Errors
/// [`ModelError::Engine`] where the graph cannot be run.
pub fn record_golden(onnx: &[u8], question: Golden) -> Result<Golden, ModelError> {
    let name = "export";
    let mut model = ModelProto::decode(onnx)
        .map_err(|error| ModelError::Format { model: name.into(), detail: error.to_string() })?;
    let explain = |detail: String| ModelError::Engine { model: name.into(), detail };
    let graph = model.graph.as_mut().ok_or_else(|| explain("no graph".into()))?;
    order_interface(graph);
    let mut state = prepare(&model, name)?;
    let mut goal = [0.0; LOCAL_CELLS];
    goal[question.goal_cell.min(LOCAL_CELLS - 1)] = 1.0;
    let cost = question.planning_cost.map(|byte| f32::from(byte) / 255.0);
    let velocity = [question.velocity.v_m_s, question.velocity.w_rad_s];
    let inputs: TVec<TValue> = INPUTS
        .iter()
        .zip([&cost[..], &goal[..], &velocity[..]])
        .map(|((_, shape), values)| Tensor::from_shape(shape, values).map(IntoTValue::into_tvalue))
        .collect::<TractResult<_>>()
        .map_err(|error| explain(error.to_string()))?;
    let outputs = state.run(inputs).map_err(|error| explain(error.to_string()))?;
    let [command, doubt] = outputs.as_slice() else { return Err(explain("not two outputs".into())) };
    Ok(Golden { command: pair(command).map_err(explain)?, doubt: pair(doubt).map_err(explain)?, ..question })
}

//! The fused tract operators: value iteration, convolutions, and the dense layers with command and doubt.

use crate::graph::{CONVOLUTIONS, HEAD, PLANE, VALUE_ITERATION};
use crate::head_convolutions::{ConvolutionChain, ConvolutionScratch};
use crate::kernels::{DenseChain, DenseScratch, ValueIteration, ValueScratch};
use crate::lanes::Lanes;
use crate::network::{CROP_COLS, CROP_ROWS, ConvolutionLayer, DenseLayer};
use std::sync::{Arc, Mutex, PoisonError};
use tract_onnx::model::{Onnx, ParsingContext};
use tract_onnx::pb::NodeProto;
use tract_onnx::tract_hir::internal::*;

/// V from m_r.
#[derive(Debug, Clone)]
struct ValueOperator {
    iteration: Arc<ValueIteration>,
    lanes: Lanes,
    scratch: Arc<Mutex<ValueScratch>>,
}

/// Planes from the crops of V and m_r.
#[derive(Debug, Clone)]
struct ConvolutionOperator {
    chain: Arc<ConvolutionChain>,
    lanes: Lanes,
    scratch: Arc<Mutex<ConvolutionScratch>>,
}

/// Command and doubt from features and u'.
#[derive(Debug, Clone)]
struct HeadOperator {
    chain: Arc<DenseChain>,
    log_range: (f32, f32),
    lanes: Lanes,
    scratch: Arc<Mutex<DenseScratch>>,
}

/// Gives an operator its name. Two are the same only where they share their weights.
macro_rules! operator {
    ($kind:ty, $name:expr, $weights:ident) => {
        impl PartialEq for $kind {
            fn eq(&self, other: &Self) -> bool {
                Arc::ptr_eq(&self.$weights, &other.$weights)
            }
        }
        impl Eq for $kind {}
        impl Op for $kind {
            fn name(&self) -> StaticName {
                $name.into()
            }
            op_as_typed_op!();
        }
    };
}

operator!(ValueOperator, VALUE_ITERATION, iteration);
operator!(ConvolutionOperator, CONVOLUTIONS, chain);
operator!(HeadOperator, HEAD, chain);

/// Teaches tract the operators.
pub(crate) fn register(onnx: &mut Onnx) {
    onnx.op_register.insert(VALUE_ITERATION, build_value);
    onnx.op_register.insert(CONVOLUTIONS, build_convolutions);
    onnx.op_register.insert(HEAD, build_head);
}

/// Says that a tensor holds floats in this shape.
fn floats_of<'r, 'p: 'r, const RANK: usize>(
    solver: &mut Solver<'r>,
    tensor: &'p TensorProxy,
    shape: [usize; RANK],
) -> InferenceResult {
    solver.equals(&tensor.datum_type, f32::datum_type())?;
    solver.equals(&tensor.shape, shape.map(|d| d.to_dim()).into_iter().collect::<TVec<TDim>>())
}

type Built = TractResult<(Box<dyn InferenceOp>, Vec<String>)>;

fn build_value(_: &ParsingContext, node: &NodeProto) -> Built {
    let kernels = |name: &str| -> TractResult<Vec<[f32; 9]>> {
        let kernel = |chunk: &[f32]| std::array::from_fn(|tap| chunk[tap]);
        Ok(floats(node, name)?.chunks_exact(9).map(kernel).collect())
    };
    let iteration = ValueIteration {
        reward: kernels("reward")?,
        bias: floats(node, "bias")?.to_vec(),
        value: kernels("value")?,
        rounds: usize::try_from(integers(node, "rounds")?[0])?,
    };
    let scratch = Arc::new(Mutex::new(ValueScratch::new(iteration.reward.len())));
    let operator = ValueOperator { iteration: Arc::new(iteration), lanes: Lanes::detect(), scratch };
    Ok((Box::new(operator), vec![]))
}

/// Weight and bias of each layer.
fn weights(node: &NodeProto) -> impl Iterator<Item = (Vec<f32>, Vec<f32>)> {
    let values = move |name| node.attribute.iter().filter(move |a| a.name == name).map(|a| a.floats.clone());
    values("weight").zip(values("bias"))
}

fn build_convolutions(_: &ParsingContext, node: &NodeProto) -> Built {
    let layers: Vec<ConvolutionLayer> = integers(node, "sizes")?
        .chunks_exact(3)
        .zip(weights(node))
        .map(|(size, (weight, bias))| ConvolutionLayer {
            inputs: size[0] as usize,
            outputs: size[1] as usize,
            stride: size[2] as usize,
            weight,
            bias,
        })
        .collect();
    let chain = ConvolutionChain::new(&layers, [CROP_ROWS, CROP_COLS]);
    let scratch = Arc::new(Mutex::new(chain.scratch()));
    let operator = ConvolutionOperator { chain: Arc::new(chain), lanes: Lanes::detect(), scratch };
    Ok((Box::new(operator), vec![]))
}

fn build_head(_: &ParsingContext, node: &NodeProto) -> Built {
    let layers: Vec<DenseLayer> = integers(node, "sizes")?
        .chunks_exact(2)
        .zip(weights(node))
        .map(|(size, (weight, bias))| DenseLayer {
            inputs: size[0] as usize,
            outputs: size[1] as usize,
            weight,
            bias,
        })
        .collect();
    let range = floats(node, "log_range")?;
    let chain = DenseChain::new(&layers);
    let scratch = Arc::new(Mutex::new(chain.scratch()));
    let operator = HeadOperator {
        chain: Arc::new(chain),
        log_range: (range[0], range[1]),
        lanes: Lanes::detect(),
        scratch,
    };
    Ok((Box::new(operator), vec![]))
}

fn floats<'a>(node: &'a NodeProto, name: &str) -> TractResult<&'a [f32]> {
    let found = node.attribute.iter().find(|attribute| attribute.name == name);
    Ok(&found.with_context(|| format!("{} has no {name}", node.op_type))?.floats)
}

fn integers<'a>(node: &'a NodeProto, name: &str) -> TractResult<&'a [i64]> {
    let found = node.attribute.iter().find(|attribute| attribute.name == name);
    Ok(&found.with_context(|| format!("{} has no {name}", node.op_type))?.ints)
}

impl EvalOp for ValueOperator {
    fn eval(&self, _: &EvalContext, inputs: TVec<TValue>) -> TractResult<TVec<TValue>> {
        let input = args_1!(inputs);
        let mut out = Tensor::zero::<f32>(&PLANE)?;
        let mut scratch = self.scratch.lock().unwrap_or_else(PoisonError::into_inner);
        let reward_map = input.try_as_plain_ram()?;
        let mut plane = out.try_as_plain_ram_mut()?;
        self.iteration.run(self.lanes, reward_map.as_slice()?, &mut scratch, plane.as_slice_mut()?);
        Ok(tvec![out.into_tvalue()])
    }
    op_out_of_plan!();
}

impl TypedOp for ValueOperator {
    fn output_facts(&self, _: &[&TypedFact]) -> TractResult<TVec<TypedFact>> {
        Ok(tvec![f32::fact(PLANE)])
    }
    as_op!();
}

impl InferenceRulesOp for ValueOperator {
    fn rules<'r, 'p: 'r, 's: 'r>(
        &'s self,
        solver: &mut Solver<'r>,
        inputs: &'p [TensorProxy],
        outputs: &'p [TensorProxy],
    ) -> InferenceResult {
        floats_of(solver, &inputs[0], PLANE)?;
        floats_of(solver, &outputs[0], PLANE)
    }
    as_op!();
    to_typed!();
}

impl ConvolutionOperator {
    /// Of what it makes.
    fn shape(&self) -> [usize; 4] {
        let [planes, rows, columns] = self.chain.shape();
        [1, planes, rows, columns]
    }
}

impl EvalOp for ConvolutionOperator {
    fn eval(&self, _: &EvalContext, inputs: TVec<TValue>) -> TractResult<TVec<TValue>> {
        let (value, reward) = args_2!(inputs);
        let (value, reward) = (value.try_as_plain_ram()?, reward.try_as_plain_ram()?);
        let mut out = Tensor::zero::<f32>(&self.shape())?;
        let mut made = out.try_as_plain_ram_mut()?;
        let mut scratch = self.scratch.lock().unwrap_or_else(PoisonError::into_inner);
        let planes = [value.as_slice()?, reward.as_slice()?];
        self.chain.run(self.lanes, planes, &mut scratch, made.as_slice_mut()?);
        Ok(tvec![out.into_tvalue()])
    }
    op_out_of_plan!();
}

impl TypedOp for ConvolutionOperator {
    fn output_facts(&self, _: &[&TypedFact]) -> TractResult<TVec<TypedFact>> {
        Ok(tvec![f32::fact(self.shape())])
    }
    as_op!();
}

impl InferenceRulesOp for ConvolutionOperator {
    fn rules<'r, 'p: 'r, 's: 'r>(
        &'s self,
        solver: &mut Solver<'r>,
        inputs: &'p [TensorProxy],
        outputs: &'p [TensorProxy],
    ) -> InferenceResult {
        inputs[..2].iter().try_for_each(|crop| floats_of(solver, crop, [1, 1, CROP_ROWS, CROP_COLS]))?;
        floats_of(solver, &outputs[0], self.shape())
    }
    as_op!();
    to_typed!();
}

impl EvalOp for HeadOperator {
    fn eval(&self, _: &EvalContext, inputs: TVec<TValue>) -> TractResult<TVec<TValue>> {
        let (features, velocity) = args_2!(inputs);
        let mut scratch = self.scratch.lock().unwrap_or_else(PoisonError::into_inner);
        let head = self.chain.run(self.lanes, features.try_as_plain_ram()?.as_slice()?, &mut scratch);
        let velocity = velocity.try_as_plain_ram()?;
        let (&[v, w], &[dv, dw, log_v, log_w]) = (velocity.as_slice::<f32>()?, head) else {
            bail!("{HEAD} has {} outputs", head.len());
        };
        let doubt = |log: f32| libm::expf(log.max(self.log_range.0).min(self.log_range.1));
        let command = Tensor::from_shape(&[1, 2], &[v + dv, w + dw])?;
        let doubt = Tensor::from_shape(&[1, 2], &[doubt(log_v), doubt(log_w)])?;
        Ok(tvec![command.into_tvalue(), doubt.into_tvalue()])
    }
    op_out_of_plan!();
}

impl TypedOp for HeadOperator {
    fn output_facts(&self, _: &[&TypedFact]) -> TractResult<TVec<TypedFact>> {
        Ok(tvec![f32::fact([1, 2]), f32::fact([1, 2])])
    }
    as_op!();
}

impl InferenceRulesOp for HeadOperator {
    fn rules<'r, 'p: 'r, 's: 'r>(
        &'s self,
        solver: &mut Solver<'r>,
        inputs: &'p [TensorProxy],
        outputs: &'p [TensorProxy],
    ) -> InferenceResult {
        let pairs = [&inputs[1], &outputs[0], &outputs[1]];
        pairs.into_iter().try_for_each(|pair| floats_of(solver, pair, [1, 2]))
    }
    fn nboutputs(&self) -> TractResult<usize> {
        Ok(2)
    }
    as_op!();
    to_typed!();
}

//! Finds the blocks of an ONNX graph that have a fused operator, and puts that operator in their place.
//!
//! The file holds standard operators only: value iteration unrolled, convolutions as Conv and Relu, dense layers as Gemm
//! and Relu. What does not have exactly that form stays as it is and runs in plain tract, correct but slow.

use crate::kernels::ValueIteration;
use crate::network::{CROP_COLS, CROP_PLANES, CROP_ROWS, ConvolutionLayer, DenseLayer, HEAD_OUTPUTS};
use sidestep_msgs::{LOCAL_CELLS, LOCAL_SIDE};
use tract_onnx::pb::{AttributeProto, GraphProto, NodeProto, TensorProto};

/// Operator name of the fused value iteration.
pub(crate) const VALUE_ITERATION: &str = "SidestepValueIteration";
/// Operator name of the fused convolutions.
pub(crate) const CONVOLUTIONS: &str = "SidestepConvolutions";
/// Operator name of the fused dense layers.
pub(crate) const HEAD: &str = "SidestepHead";

/// The value iteration block as found.
#[derive(Debug)]
pub(crate) struct ValueBlock {
    /// Weights and rounds.
    pub(crate) iteration: ValueIteration,
    /// Name of m_r.
    pub(crate) input: String,
    /// Positions of its nodes.
    nodes: Vec<usize>,
}

/// The convolutions as found.
#[derive(Debug)]
pub(crate) struct ConvolutionBlock {
    /// From the crops on.
    pub(crate) layers: Vec<ConvolutionLayer>,
    /// Names of the crops.
    pub(crate) inputs: Vec<String>,
    /// Positions of its nodes.
    nodes: Vec<usize>,
}

/// The dense layers as found.
#[derive(Debug)]
pub(crate) struct HeadBlock {
    /// From features to four outputs.
    pub(crate) layers: Vec<DenseLayer>,
    /// Range of the logarithm of the doubt.
    pub(crate) log_range: (f32, f32),
    /// Name of the features.
    pub(crate) input: String,
    /// Positions of its nodes.
    nodes: Vec<usize>,
}

/// A graph with look-up by name.
pub(crate) struct View<'a> {
    graph: &'a GraphProto,
}

impl<'a> View<'a> {
    /// Looks at a graph.
    pub(crate) fn new(graph: &'a GraphProto) -> Self {
        Self { graph }
    }

    fn producer(&self, name: &str) -> Result<(usize, &'a NodeProto), String> {
        let found =
            self.graph.node.iter().enumerate().find(|(_, node)| node.output.iter().any(|o| o == name));
        found.ok_or_else(|| format!("no node makes \"{name}\""))
    }

    /// The producer of `name`, which must be a `kind` with `inputs` inputs.
    fn step(&self, name: &str, kind: &str, inputs: usize) -> Result<(usize, &'a NodeProto), String> {
        let (index, node) = self.producer(name)?;
        if node.op_type == kind && node.input.len() == inputs && node.output.len() == 1 {
            return Ok((index, node));
        }
        let found = format!("{} with {} inputs", node.op_type, node.input.len());
        Err(format!("\"{name}\" is made by {found}, not by {kind} with {inputs}"))
    }

    fn constant(&self, name: &str) -> Result<&'a TensorProto, String> {
        let found = self.graph.initializer.iter().find(|tensor| tensor.name == name);
        found.ok_or_else(|| format!("\"{name}\" is no constant"))
    }

    fn floats(&self, name: &str, shape: &[i64]) -> Result<Vec<f32>, String> {
        let tensor = self.constant(name)?;
        if tensor.dims != shape {
            return Err(format!("\"{name}\" has shape {:?}, not {shape:?}", tensor.dims));
        }
        let count = shape.iter().product::<i64>() as usize;
        let values = float_values(tensor).filter(|values| values.len() == count);
        values.ok_or_else(|| format!("\"{name}\" does not hold {count} floats"))
    }

    fn integers(&self, name: &str) -> Result<Vec<i64>, String> {
        let tensor = self.constant(name)?;
        if !tensor.int64_data.is_empty() {
            return Ok(tensor.int64_data.clone());
        }
        let read = |bytes: &[u8]| bytes.try_into().map(i64::from_le_bytes).unwrap_or_default();
        Ok(tensor.raw_data.chunks_exact(8).map(read).collect())
    }

    /// 3x3 kernels of a Conv with unit stride and a border of zeros.
    fn kernels(&self, node: &NodeProto) -> Result<Vec<[f32; 9]>, String> {
        let (name, stride) = (&node.name, bordered_stride(node)?);
        let channels = self.constant(&node.input[1])?.dims.first().copied().unwrap_or(0);
        if !(1..=64).contains(&channels) || stride != 1 {
            return Err(format!("Conv \"{name}\" has {channels} channels, not 1 to 64, or stride {stride}"));
        }
        let weights = self.floats(&node.input[1], &[channels, 1, 3, 3])?;
        let kernel = |chunk: &[f32]| std::array::from_fn(|tap| chunk[tap]);
        Ok(weights.chunks_exact(9).map(kernel).collect())
    }

    /// The block between `vi/reward` and `vi/value`.
    ///
    /// # Errors
    /// Where it differs from K equal rounds.
    pub(crate) fn value_block(&self) -> Result<ValueBlock, String> {
        let (reward_node, reward) = self.step("vi/reward", "Conv", 3)?;
        let reward_kernels = self.kernels(reward)?;
        let bias = self.floats(&reward.input[2], &[reward_kernels.len() as i64])?;
        let mut nodes = vec![reward_node];
        let mut current = "vi/value";
        let mut shared: Option<&str> = None;
        let mut value = Vec::new();
        let mut rounds = 0;
        while self.constant(current).is_err() {
            let (best_index, best) = self.step(current, "ReduceMax", 1)?;
            require_channel_maximum(best)?;
            let (sum_index, sum) = self.step(&best.input[0], "Add", 2)?;
            let other = usize::from(sum.input[0] == "vi/reward");
            if sum.input[1 - other] != "vi/reward" {
                return Err(format!("\"{}\" does not add vi/reward", sum.name));
            }
            let (conv_index, conv) = self.step(&sum.input[other], "Conv", 2)?;
            match shared {
                None => value = self.kernels(conv)?,
                Some(name)
                    if name == conv.input[1] && conv.attribute == self.graph.node[nodes[1]].attribute => {}
                Some(name) => return Err(format!("round \"{}\" does not share \"{name}\"", conv.name)),
            }
            shared = Some(&conv.input[1]);
            nodes.extend([conv_index, sum_index, best_index]);
            rounds += 1;
            if rounds > 10_000 {
                return Err("the rounds do not end".into());
            }
            current = &conv.input[0];
        }
        let side = LOCAL_SIDE as i64;
        let zero = self.floats(current, &[1, 1, side, side])?.iter().all(|x| *x == 0.0);
        if !zero || rounds == 0 || value.len() != reward_kernels.len() {
            return Err("the first round does not start from zero with as many channels as vi/reward".into());
        }
        self.require_private(&nodes, &["vi/value"])?;
        let iteration = ValueIteration { reward: reward_kernels, bias, value, rounds };
        Ok(ValueBlock { iteration, input: reward.input[0].clone(), nodes })
    }

    /// The block from the two crops to `convolved`; `None` where nothing but value iteration convolves.
    ///
    /// # Errors
    /// Where it differs from the form written by the exporter.
    pub(crate) fn convolution_block(&self) -> Result<Option<ConvolutionBlock>, String> {
        let planning = |node: &NodeProto| node.output.iter().all(|name| name.starts_with("vi/"));
        if self.graph.node.iter().all(|node| node.op_type != "Conv" || planning(node)) {
            return Ok(None);
        }
        let (mut nodes, mut layers) = (Vec::new(), Vec::new());
        let mut current = "convolved";
        while let Ok((relu_index, relu)) = self.step(current, "Relu", 1) {
            let (conv_index, conv) = self.step(&relu.input[0], "Conv", 3)?;
            layers.insert(0, self.convolution(conv)?);
            nodes.extend([relu_index, conv_index]);
            current = &conv.input[0];
            if layers.len() > 64 {
                return Err("the convolutions do not end".into());
            }
        }
        let (concat_index, concat) = self.step(current, "Concat", CROP_PLANES)?;
        nodes.push(concat_index);
        if concat.attribute.iter().any(|a| a.name != "axis" || a.i != 1) {
            return Err(format!("\"{current}\" does not join planes"));
        }
        concat.input.iter().try_for_each(|plane| self.require_crop(plane))?;
        let joined = layers.windows(2).all(|pair| pair[0].outputs == pair[1].inputs);
        if !joined || layers.first().is_none_or(|layer| layer.inputs != CROP_PLANES) {
            return Err("the convolutions do not fit each other".into());
        }
        self.require_private(&nodes, &["convolved"])?;
        Ok(Some(ConvolutionBlock { layers, inputs: concat.input.clone(), nodes }))
    }

    fn convolution(&self, conv: &NodeProto) -> Result<ConvolutionLayer, String> {
        let dims = &self.constant(&conv.input[1])?.dims;
        let &[outputs, inputs, 3, 3] = dims.as_slice() else {
            return Err(format!("\"{}\" has shape {dims:?}", conv.input[1]));
        };
        if ![outputs, inputs].iter().all(|planes| (1..=1024).contains(planes)) {
            return Err(format!("Conv \"{}\" has {inputs} and {outputs} planes, not 1 to 1024", conv.name));
        }
        Ok(ConvolutionLayer {
            inputs: inputs as usize,
            outputs: outputs as usize,
            stride: bordered_stride(conv)?,
            weight: self.floats(&conv.input[1], &[outputs, inputs, 3, 3])?,
            bias: self.floats(&conv.input[2], &[outputs])?,
        })
    }

    /// One plane of the size of the crop, cut out or that less a number.
    fn require_crop(&self, name: &str) -> Result<(), String> {
        let cut = self.step(name, "Sub", 2).map_or(name, |(_, sub)| &sub.input[0]);
        let (_, slice) = self.step(cut, "Slice", 4)?;
        let (from, to) = (self.integers(&slice.input[1])?, self.integers(&slice.input[2])?);
        let size: Vec<i64> = to.iter().zip(&from).map(|(to, from)| to.saturating_sub(*from)).collect();
        let whole = size == [CROP_ROWS as i64, CROP_COLS as i64] && self.integers(&slice.input[3])? == [2, 3];
        whole
            .then_some(())
            .ok_or_else(|| format!("\"{cut}\" is not a crop of {CROP_ROWS} x {CROP_COLS} cells"))
    }

    /// The dense layers that end in `command` and `doubt`.
    ///
    /// # Errors
    /// Where they differ from the form written by the exporter.
    pub(crate) fn head_block(&self) -> Result<HeadBlock, String> {
        let (add_index, add) = self.step("command", "Add", 2)?;
        let (exp_index, exp) = self.step("doubt", "Exp", 1)?;
        let (clip_index, clip) = self.step(&exp.input[0], "Clip", 3)?;
        let log_range = (self.floats(&clip.input[1], &[])?[0], self.floats(&clip.input[2], &[])?[0]);
        let change = usize::from(add.input[0] == "velocity");
        if add.input[1 - change] != "velocity" {
            return Err("command does not add velocity".into());
        }
        let (change_index, change) = self.step(&add.input[change], "Slice", 4)?;
        let (log_index, log) = self.step(&clip.input[0], "Slice", 4)?;
        for (slice, from, to) in [(change, 0, 2), (log, 2, 4)] {
            let range = (self.integers(&slice.input[1])?, self.integers(&slice.input[2])?);
            if range != (vec![from], vec![to]) || self.integers(&slice.input[3])? != [1] {
                return Err(format!("\"{}\" is not columns {from} to {to}", slice.name));
            }
        }
        if change.input[0] != log.input[0] {
            return Err("command and doubt do not share a layer".into());
        }
        let mut nodes = vec![add_index, exp_index, clip_index, change_index, log_index];
        let mut layers = Vec::new();
        let mut current = &change.input[0];
        loop {
            let (gemm_index, gemm) = self.step(current, "Gemm", 3)?;
            layers.insert(0, self.layer(gemm)?);
            nodes.push(gemm_index);
            current = &gemm.input[0];
            let Ok((relu_index, relu)) = self.step(current, "Relu", 1) else { break };
            nodes.push(relu_index);
            current = &relu.input[0];
        }
        let joined = layers.windows(2).all(|pair| pair[0].outputs == pair[1].inputs);
        if !joined || layers[layers.len() - 1].outputs != HEAD_OUTPUTS {
            return Err("the dense layers do not fit each other".into());
        }
        self.require_private(&nodes, &["command", "doubt"])?;
        Ok(HeadBlock { layers, log_range, input: current.clone(), nodes })
    }

    fn layer(&self, gemm: &NodeProto) -> Result<DenseLayer, String> {
        if !gemm.attribute.is_empty() {
            return Err(format!("Gemm \"{}\" is scaled or transposed", gemm.name));
        }
        let dims = &self.constant(&gemm.input[1])?.dims;
        let (&[inputs, outputs], true) = (dims.as_slice(), dims.iter().all(|d| (1..=8192).contains(d)))
        else {
            return Err(format!("\"{}\" has shape {dims:?}", gemm.input[1]));
        };
        Ok(DenseLayer {
            inputs: inputs as usize,
            outputs: outputs as usize,
            weight: self.floats(&gemm.input[1], &[inputs, outputs])?,
            bias: self.floats(&gemm.input[2], &[outputs])?,
        })
    }

    /// Nothing outside the block may read what it makes, but for `ends`.
    fn require_private(&self, nodes: &[usize], ends: &[&str]) -> Result<(), String> {
        let inner: Vec<&String> = nodes
            .iter()
            .flat_map(|index| &self.graph.node[*index].output)
            .filter(|name| !ends.contains(&name.as_str()))
            .collect();
        let outside = self.graph.node.iter().enumerate().filter(|(index, _)| !nodes.contains(index));
        let mut read =
            outside.flat_map(|(_, node)| &node.input).chain(self.graph.output.iter().map(|o| &o.name));
        read.find(|name| inner.contains(name))
            .map_or(Ok(()), |name| Err(format!("\"{name}\" is used outside its block")))
    }
}

/// Stride of a 3x3 Conv with a border of zeros.
fn bordered_stride(node: &NodeProto) -> Result<usize, String> {
    let (name, mut stride) = (&node.name, 1);
    for attribute in &node.attribute {
        let expected: &[i64] = match attribute.name.as_str() {
            "pads" => &[1, 1, 1, 1],
            "kernel_shape" => &[3, 3],
            "dilations" => &[1, 1],
            "strides" => {
                stride =
                    attribute.ints.first().copied().filter(|stride| (1..=4).contains(stride)).unwrap_or(1);
                &[stride, stride]
            }
            "group" if attribute.i == 1 => continue,
            other => return Err(format!("Conv \"{name}\" has {other} = {}", attribute.i)),
        };
        if attribute.ints != expected {
            return Err(format!("Conv \"{name}\" has {} = {:?}", attribute.name, attribute.ints));
        }
    }
    if !node.attribute.iter().any(|attribute| attribute.name == "pads") {
        return Err(format!("Conv \"{name}\" has no border"));
    }
    Ok(stride as usize)
}

fn require_channel_maximum(node: &NodeProto) -> Result<(), String> {
    let over_channels = node.attribute.iter().any(|a| a.name == "axes" && a.ints == [1]);
    let keeps = node.attribute.iter().all(|a| a.name != "keepdims" || a.i == 1);
    let message = || format!("\"{}\" is not a maximum over channels", node.name);
    (over_channels && keeps).then_some(()).ok_or_else(message)
}

/// The floats of a tensor, however stored; `None` for another type.
fn float_values(tensor: &TensorProto) -> Option<Vec<f32>> {
    const FLOAT: i32 = 1;
    if tensor.data_type != FLOAT {
        return None;
    }
    if !tensor.float_data.is_empty() {
        return Some(tensor.float_data.clone());
    }
    let read = |bytes: &[u8]| bytes.try_into().map(f32::from_le_bytes).unwrap_or_default();
    Some(tensor.raw_data.chunks_exact(4).map(read).collect())
}

/// Puts the fused operators in the place of the blocks found.
pub(crate) fn replace(
    graph: &mut GraphProto,
    value: Option<ValueBlock>,
    convolutions: Option<ConvolutionBlock>,
    head: Option<HeadBlock>,
) {
    let blocks = [
        value.map(ValueBlock::into_operator),
        convolutions.map(ConvolutionBlock::into_operator),
        head.map(HeadBlock::into_operator),
    ];
    let (removed, fused): (Vec<Vec<usize>>, Vec<NodeProto>) = blocks.into_iter().flatten().unzip();
    let mut index = 0;
    graph.node.retain(|_| {
        index += 1;
        !removed.iter().flatten().any(|removed| *removed == index - 1)
    });
    graph.node.extend(fused);
    let used: Vec<String> = graph.node.iter().flat_map(|node| node.input.clone()).collect();
    graph.initializer.retain(|tensor| used.contains(&tensor.name));
}

impl ValueBlock {
    /// The nodes that go, and what comes in their place.
    fn into_operator(self) -> (Vec<usize>, NodeProto) {
        let flat = |kernels: &[[f32; 9]]| kernels.iter().flatten().copied().collect::<Vec<f32>>();
        let attribute = vec![
            floats("reward", flat(&self.iteration.reward)),
            floats("bias", self.iteration.bias),
            floats("value", flat(&self.iteration.value)),
            integers("rounds", vec![self.iteration.rounds as i64]),
        ];
        (self.nodes, node(VALUE_ITERATION, vec![self.input], &["vi/value"], attribute))
    }
}

impl ConvolutionBlock {
    /// As [`ValueBlock::into_operator`].
    fn into_operator(self) -> (Vec<usize>, NodeProto) {
        let sizes = self.layers.iter().flat_map(|l| [l.inputs, l.outputs, l.stride].map(|size| size as i64));
        let mut attribute = vec![integers("sizes", sizes.collect())];
        for layer in self.layers {
            attribute.extend([floats("weight", layer.weight), floats("bias", layer.bias)]);
        }
        (self.nodes, node(CONVOLUTIONS, self.inputs, &["convolved"], attribute))
    }
}

impl HeadBlock {
    /// As [`ValueBlock::into_operator`].
    fn into_operator(self) -> (Vec<usize>, NodeProto) {
        let sizes = self.layers.iter().flat_map(|l| [l.inputs as i64, l.outputs as i64]).collect();
        let mut attribute =
            vec![integers("sizes", sizes), floats("log_range", vec![self.log_range.0, self.log_range.1])];
        for layer in self.layers {
            attribute.extend([floats("weight", layer.weight), floats("bias", layer.bias)]);
        }
        let inputs = vec![self.input, "velocity".into()];
        (self.nodes, node(HEAD, inputs, &["command", "doubt"], attribute))
    }
}

fn node(kind: &str, inputs: Vec<String>, outputs: &[&str], attribute: Vec<AttributeProto>) -> NodeProto {
    NodeProto {
        op_type: kind.into(),
        name: kind.into(),
        input: inputs,
        output: outputs.iter().map(|s| (*s).to_owned()).collect(),
        attribute,
        ..NodeProto::default()
    }
}

fn floats(name: &str, floats: Vec<f32>) -> AttributeProto {
    AttributeProto { name: name.into(), floats, ..AttributeProto::default() }
}

fn integers(name: &str, ints: Vec<i64>) -> AttributeProto {
    AttributeProto { name: name.into(), ints, ..AttributeProto::default() }
}

/// Cells of the planes that the fused value iteration works on, for the operator's shape rules.
pub(crate) const PLANE: [usize; 4] = [1, 1, LOCAL_SIDE, LOCAL_SIDE];
const _: () = assert!(PLANE[2] * PLANE[3] == LOCAL_CELLS);

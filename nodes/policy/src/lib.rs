//! The policy: the paper's value iteration network, which turns planning cost, goal and velocity into a command.
//!
//! One ONNX file of standard operators, embedded in the binary or named in the configuration, checked against its
//! contract and against a recorded answer before the first frame. Input: `local_map` and `local_goal` of one frame;
//! output: one `Proposal` with the network's doubt. The network alone makes the command; nothing plans behind it.
//!
//! Promises: the same bytes on every CPU with fused multiply-add; a model that does not fit is refused with what was
//! found and what is needed; a not-finite answer is a fault, never a command; no panic for any input.

#[macro_use]
mod lanes;
mod config;
mod contract;
mod convolution;
mod error;
mod export;
#[cfg(test)]
mod fixture;
mod graph;
mod head_convolutions;
mod kept_maps;
mod kernels;
mod network;
mod node;
mod operators;
mod policy;

pub use config::Config;
pub use contract::{Contract, Golden, fingerprint};
pub use convolution::{ROW_CELLS, convolve};
pub use error::ModelError;
pub use export::to_onnx;
pub use head_convolutions::{ConvolutionChain, ConvolutionScratch};
pub use kept_maps::KeptMaps;
pub use kernels::{DenseChain, DenseScratch, ValueIteration, ValueScratch};
#[doc(hidden)]
pub use lanes::Kind as LaneKind;
pub use lanes::{Lanes, kernel_class, multiply_add};
pub use network::*;
pub use node::run;
pub use policy::{Answer, Policy, TOLERANCE, embedded, record_golden};

//! The channels of a run over the Foxglove WebSocket.

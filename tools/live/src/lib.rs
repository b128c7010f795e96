//! The view channels of a run over the Foxglove WebSocket, for Foxglove and Lichtblick on another screen.
//!
//! A process of its own that only listens: writers never wait for it, slow viewers lose the oldest messages, and no node
//! gets an async runtime. The messages are those of a recording, made by the same [`View`].

mod source;

use foxglove::{Context, PartialMetadata, RawChannel, Schema, WebSocketServer};
use sidestep_bus::{Link, NodeError, Step, host_ns, pause, wall_ns};
use sidestep_msgs::DEPTH;
use sidestep_recorder::{VIEW_CHANNELS, View, ViewSettings, depth_image_schema};
use source::Sources;
use std::sync::Arc;
use std::time::Duration;

/// Pace of looking for messages; half a tick of the arbiter.
const LOOK_EVERY: Duration = Duration::from_millis(5);

/// Why a run cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The run cannot be read.
    #[error(transparent)]
    Run(#[from] NodeError),
    /// The server cannot listen there or has no channel.
    #[error("live view on {address}: {detail}; is another one running? name a free --port")]
    Serve {
        /// Address and port.
        address: String,
        /// What the server said.
        detail: String,
    },
}

/// Where to serve, and how much.
#[derive(Debug, Clone)]
pub struct Options {
    /// Address to listen on.
    pub address: String,
    /// Port; 0 = any free one.
    pub port: u16,
    /// `[Hz]` (0, 100] depth images sent at most.
    pub image_hz: f64,
    /// What is shown beyond the messages.
    pub view: ViewSettings,
}

/// The channels that viewers subscribe to.
struct Outlet {
    view: View,
    channels: Vec<Arc<RawChannel>>,
    image: Arc<RawChannel>,
    image_every_ns: u64,
    image_ns: u64,
}

fn channel(context: &Arc<Context>, name: &str, schema: Schema) -> Result<Arc<RawChannel>, String> {
    let builder = context.channel_builder(name).schema(schema).message_encoding("protobuf");
    builder.build_raw().map_err(|error| error.to_string())
}

impl Outlet {
    fn open(context: &Arc<Context>, options: &Options) -> Result<Self, String> {
        let settings = ViewSettings { shown: true, ..options.view.clone() };
        let channels = VIEW_CHANNELS.iter().map(|row| channel(context, row.name, row.schema()));
        Ok(Self {
            view: View::new(&settings, wall_ns().saturating_sub(host_ns()) as i64),
            channels: channels.collect::<Result<_, _>>()?,
            image: channel(context, DEPTH.row().name, depth_image_schema())?,
            image_every_ns: (1e9 / options.image_hz.clamp(0.01, 100.0)) as u64,
            image_ns: 0,
        })
    }

    /// Whether the next depth frame is to be shown: images are large, so they come at a rate of their own.
    fn wants_image(&self, received_ns: u64) -> bool {
        received_ns.saturating_sub(self.image_ns) >= self.image_every_ns
    }

    /// Shows a record: header and message, one after the other.
    fn show(&mut self, row: &'static sidestep_msgs::TopicRow, record: &[u8], received_ns: u64) {
        let stamp = PartialMetadata::with_log_time(wall_ns());
        for (shown, message) in self.view.show(row, record, received_ns) {
            self.channels[shown.index].log_with_meta(message, stamp);
        }
        if row.index == DEPTH.index {
            self.image_ns = received_ns;
            if self.image.has_sinks() {
                let frame = &record[size_of::<sidestep_msgs::Header>()..];
                self.image.log_with_meta(&self.view.image(frame), stamp);
            }
        }
    }
}

/// Serves a run while `goes_on` says so, which is asked at every look; `ready` is told the port once viewers can come.
///
/// # Errors
/// [`LiveError`].
pub fn serve(
    mut link: Link,
    options: &Options,
    ready: impl FnOnce(u16),
    mut goes_on: impl FnMut() -> bool,
) -> Result<(), LiveError> {
    let address = format!("{}:{}", options.address, options.port);
    let fault = |detail: String| LiveError::Serve { address: address.clone(), detail };
    // One thread is enough for viewers; the cores are for the drive.
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build();
    let runtime = runtime.map_err(|error| fault(error.to_string()))?;
    let context = Context::new();
    let mut outlet = Outlet::open(&context, options).map_err(fault)?;
    let server = WebSocketServer::new().name("sidestep").context(&context);
    let server = runtime
        .block_on(server.bind(options.address.clone(), options.port).start())
        .map_err(|error| fault(error.to_string()))?;
    let mut sources = Sources::open(&link)?;
    ready(server.port());
    let mut step = Step::new();
    while goes_on() {
        link.look(&mut step)?;
        sources.drain(&mut step, &mut outlet)?;
        pause(LOOK_EVERY);
    }
    runtime.block_on(server.stop().wait());
    Ok(())
}

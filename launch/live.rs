//! `sidestep live`: a run on the screen of Foxglove or Lichtblick.

#[cfg(not(feature = "live"))]
use crate::failure::Failure;
use clap::Args;

/// Where to serve.
#[derive(Debug, Args)]
pub(crate) struct LiveArguments {
    /// Address to listen on; viewers on other machines need 0.0.0.0, and the network is trusted with it.
    #[arg(long, default_value = "127.0.0.1")]
    address: String,
    /// Port to listen on.
    #[arg(long, default_value_t = 8765)]
    port: u16,
    /// `[Hz]` depth images sent at most.
    #[arg(long, default_value_t = 5.0)]
    image_hz: f64,
}

/// Without the feature there is no server in the binary.
///
/// # Errors
/// Exit code 2 with the way to build it.
#[cfg(not(feature = "live"))]
pub(crate) fn live(arguments: &LiveArguments) -> Result<(), Failure> {
    let LiveArguments { address, port, .. } = arguments;
    let remedy = "build it with `cargo build --release --features live`";
    Err(Failure::usage(format!("this binary has no live view to serve on {address}:{port}; {remedy}")))
}

#[cfg(feature = "live")]
pub(crate) use served::live;

#[cfg(feature = "live")]
mod served {
    use super::LiveArguments;
    use crate::failure::Failure;
    use crate::look::{join, runs};
    use crate::output::line;
    use crate::roles::view_of;
    use sidestep_bus::{host_ns, live_domains};
    use sidestep_live::{LiveError, Options, serve};
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};

    /// `[ns]` host time between two looks whether the run still lives.
    const ALIVE_EVERY_NS: u64 = 500_000_000;

    /// Serves the newest run until it ends or Ctrl-C.
    ///
    /// # Errors
    /// Exit code 2 for a rate that cannot be, 3 where no run lives or the port is taken.
    pub(crate) fn live(arguments: &LiveArguments) -> Result<(), Failure> {
        let image_hz = arguments.image_hz;
        if !(image_hz > 0.0 && image_hz <= 100.0) {
            return Err(Failure::usage(format!(
                "--image-hz is {image_hz}, needed: more than 0, at most 100"
            )));
        }
        let run = runs()?.remove(0);
        let link = join(&run, "live")?;
        let (address, port) = (arguments.address.clone(), arguments.port);
        let options = Options { address, port, image_hz, view: view_of(&run)? };
        let asked = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            signal_hook::flag::register(signal, asked.clone())
                .map_err(|error| Failure::io(format!("Ctrl-C cannot be watched: {error}")))?;
        }
        let mut look_ns = 0;
        let goes_on = || {
            let due = host_ns() >= look_ns;
            if due {
                look_ns = host_ns() + ALIVE_EVERY_NS;
            }
            !asked.load(Ordering::Relaxed) && (!due || live_domains().contains(&run))
        };
        let ready = |port| {
            line(&format!(
                "open ws://{}:{port} in Foxglove or Lichtblick; Ctrl-C ends the view",
                options.address
            ));
        };
        serve(link, &options, ready, goes_on).map_err(|error| match error {
            LiveError::Run(error) => error.into(),
            LiveError::Serve { .. } => Failure::io(error.to_string()),
        })
    }
}

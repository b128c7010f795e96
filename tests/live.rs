//! `sidestep live`: a run on another screen, where the binary was built for it.

use crate::harness::run;

#[cfg(not(feature = "live"))]
#[test]
fn without_its_feature_the_live_view_says_how_to_build_it() {
    let outcome = run(&["live"]);
    assert_eq!(outcome.code, 2, "{}", outcome.err);
    assert!(outcome.err.contains("cargo build --release --features live"), "{}", outcome.err);
}

#[cfg(feature = "live")]
mod served {
    use crate::harness::{Alone, Folder, Running, sidestep};
    use sidestep_bus::environment;
    use std::io::{BufRead, BufReader, Read, Write};
    use std::net::TcpStream;
    use std::process::Stdio;

    #[test]
    fn a_rate_that_cannot_be_is_refused() {
        let outcome = super::run(&["live", "--image-hz", "0"]);
        assert_eq!(outcome.code, 2, "{}", outcome.err);
        assert!(outcome.err.contains("--image-hz is 0, needed"), "{}", outcome.err);
    }

    /// A viewer joins a drive; the view ends with the run, in order.
    #[test]
    fn a_live_view_offers_its_channels_and_ends_with_the_run() {
        let _alone = Alone::wait();
        let folder = Folder::new("live");
        let recordings = folder.join("recordings").display().to_string();
        let drive = ["run", "sim", "--record", &recordings, "--set", "supervision.start_ms=60000"];
        let mut drive = Running::start(sidestep(&drive));
        let domain = drive.wait_for("the arbiter", |drive| drive.domain("arbiter"));
        let mut live = sidestep(&["live", "--port", "0"]);
        live.env(environment::DOMAIN, &domain.prefix).env(environment::ROOT, &domain.root);
        let mut live = live.stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(live.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.split("ws://").nth(1).unwrap().split_whitespace().next().unwrap().to_owned();
        let mut viewer = TcpStream::connect(address).unwrap();
        let request = "GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
            Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\
            Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n";
        viewer.write_all(request.as_bytes()).unwrap();
        let mut text = String::new();
        while !text.contains("/view/health/guard") {
            let mut bytes = [0; 4096];
            let count = viewer.read(&mut bytes).unwrap();
            assert!(count > 0, "the view ended: {text}");
            text.push_str(&String::from_utf8_lossy(&bytes[..count]));
        }
        drive.signal(libc::SIGINT);
        let outcome = drive.finish();
        assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
        assert!(live.wait().unwrap().success());
    }
}

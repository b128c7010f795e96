//! A live view as a viewer meets it: a WebSocket, channels, a subscription, messages.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test says what it expects by failing")]

use foxglove::Decode;
use foxglove::messages::Grid;
use sidestep_bus::{Domain, Link, Step, host_ns, pause};
use sidestep_live::{LiveError, Options, serve};
use sidestep_msgs::{LOCAL_GRID, LOCAL_MAP, LocalMap};
use sidestep_recorder::{VIEW_CHANNELS, ViewSettings};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::time::Duration;

/// Text and binary frames of the WebSocket protocol (RFC 6455).
const TEXT: u8 = 1;
const BINARY: u8 = 2;

/// As much of a WebSocket client as a test needs.
struct Viewer(TcpStream);

impl Viewer {
    fn join(port: u16) -> Self {
        let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        let request = "GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
            Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\
            Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n";
        stream.write_all(request.as_bytes()).unwrap();
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            stream.read_exact(&mut byte).unwrap();
            head.push(byte[0]);
        }
        assert!(head.starts_with(b"HTTP/1.1 101"), "{}", String::from_utf8_lossy(&head));
        Self(stream)
    }

    fn number(&mut self, bytes: usize) -> u64 {
        let mut number = [0; 8];
        self.0.read_exact(&mut number[8 - bytes..]).unwrap();
        u64::from_be_bytes(number)
    }

    fn frame(&mut self) -> (u8, Vec<u8>) {
        let head = self.number(2);
        let size = match head & 0x7f {
            126 => self.number(2),
            127 => self.number(8),
            small => small,
        };
        let mut payload = vec![0; size as usize];
        self.0.read_exact(&mut payload).unwrap();
        ((head >> 8 & 15) as u8, payload)
    }

    /// Sends a short text, masked with zeros as a client must mask.
    fn say(&mut self, text: &str) {
        let size = text.len() as u16;
        let mut frame = vec![0x80 | TEXT, 0x80 | 126];
        frame.extend_from_slice(&size.to_be_bytes());
        frame.extend_from_slice(&[0; 4]);
        frame.extend_from_slice(text.as_bytes());
        self.0.write_all(&frame).unwrap();
    }
}

fn options(port: u16) -> Options {
    Options { address: "127.0.0.1".into(), port, image_hz: 5.0, view: ViewSettings::default() }
}

/// Numbers of all channels offered, by name, once there are as many as the table has.
fn offered(viewer: &mut Viewer) -> Vec<(String, u64)> {
    let mut channels = Vec::new();
    while channels.len() < VIEW_CHANNELS.len() + 1 {
        let (kind, payload) = viewer.frame();
        if kind != TEXT {
            continue;
        }
        let word: serde_json::Value = serde_json::from_slice(&payload).unwrap();
        for channel in word["channels"].as_array().into_iter().flatten() {
            assert_eq!(channel["encoding"], "protobuf");
            channels.push((channel["topic"].as_str().unwrap().to_owned(), channel["id"].as_u64().unwrap()));
        }
    }
    channels
}

#[test]
fn a_viewer_gets_all_channels_and_the_map_as_it_is() {
    let run = host_ns() & 0xffff_ffff_ffff;
    let domain = Domain::create(run).unwrap();
    let mut link = Link::attach(&domain.name, "test", run, 0).unwrap();
    let mut maps = link.outbox(LOCAL_MAP).unwrap();
    let name = domain.name.clone();
    let stop = AtomicBool::new(false);
    let (told, port) = channel();
    std::thread::scope(|scope| {
        let server = scope.spawn(|| {
            let link = Link::attach(&name, "live", run, 0).unwrap();
            serve(link, &options(0), |port| told.send(port).unwrap(), || !stop.load(Ordering::Relaxed))
        });
        let mut viewer = Viewer::join(port.recv().unwrap());
        let channels = offered(&mut viewer);
        for needed in VIEW_CHANNELS.iter().map(|channel| channel.name).chain(["depth"]) {
            assert!(channels.iter().any(|(name, _)| name == needed), "{needed} in {channels:?}");
        }
        let id = channels.iter().find(|(name, _)| name == "/view/local_map").unwrap().1;
        viewer.say(&format!(r#"{{"op":"subscribe","subscriptions":[{{"id":7,"channelId":{id}}}]}}"#));
        // Until the subscription holds, maps go by unseen.
        viewer.0.set_nonblocking(true).unwrap();
        let mut step = Step::new();
        let mut waiting = [0; 1];
        while viewer.0.peek(&mut waiting).is_err() {
            link.look(&mut step).unwrap();
            maps.send(&mut step, |map: &mut LocalMap| {
                map.occupancy[LOCAL_GRID.index(1.55, 0.35).unwrap()] = 200;
            })
            .unwrap();
            pause(Duration::from_millis(20));
        }
        viewer.0.set_nonblocking(false).unwrap();
        let payload = loop {
            match viewer.frame() {
                (BINARY, payload) if payload[0] == 1 => break payload,
                _ => {}
            }
        };
        // Opcode, subscription, log time, message.
        assert_eq!(payload[1..5], 7_u32.to_le_bytes());
        let grid = Grid::decode(&payload[13..]).ok().unwrap();
        let (column, row) = (((1.55 + 0.4) / 0.1) as usize, ((0.35 + 1.4) / 0.1) as usize);
        assert_eq!(grid.data[row * grid.row_stride as usize + column * grid.cell_stride as usize], 200);
        stop.store(true, Ordering::Relaxed);
        server.join().unwrap().unwrap();
    });
}

#[test]
fn a_port_that_is_taken_is_named() {
    let run = (host_ns() & 0xffff_ffff_ffff) | 1 << 47;
    let domain = Domain::create(run).unwrap();
    let link = Link::attach(&domain.name, "live", run, 0).unwrap();
    let holder = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = holder.local_addr().unwrap().port();
    let error = serve(link, &options(port), |_| (), || false).unwrap_err();
    assert!(matches!(error, LiveError::Serve { .. }), "{error}");
    assert!(error.to_string().contains(&format!("127.0.0.1:{port}")), "{error}");
}

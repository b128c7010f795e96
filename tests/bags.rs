//! ROS 2 bags as a user meets them: written by an independent writer, imported, played, exported, refused.

use crate::harness::{Alone, Folder, Outcome, run, run_with_summary};
use sidestep_import::{Options, Placing, Source, Up};
use sidestep_msgs::{DEPTH, DepthFrame, ODOMETRY, Odometry};
use sidestep_player::{Entry, Messages};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

const BAGS: &str = "tests/data/bags";
/// `[Hz]` the HoloLens walk has no stamps of its own.
const RATE_HZ: &str = "10";

/// Imports what must be refused with this code and say all of this; nothing may be left under the name.
fn refused(source: &str, options: &[&str], code: i32, says: &[&str]) {
    let folder = Folder::new("refused");
    let out = folder.join("out.mcap");
    let outcome = run(&[&["import", source, &out.display().to_string()], options].concat());
    assert_eq!(outcome.code, code, "{source}: {}{}", outcome.out, outcome.err);
    for text in says {
        assert!(outcome.err.contains(text), "{source}: no \"{text}\" in:\n{}", outcome.err);
    }
    assert!(!out.exists(), "{source}");
}

/// Python with the independent reader and writer, or `None` with a line that says what is skipped.
fn python(what: &str) -> Option<PathBuf> {
    let python = std::env::var_os("SIDESTEP_PYTHON").map_or_else(|| "python3".into(), PathBuf::from);
    let found = Command::new(&python).args(["-c", "import mcap_ros2"]).output();
    let works = found.is_ok_and(|output| output.status.success());
    if !works {
        println!("skipped: {} has no mcap-ros2-support ({what})", python.display());
    }
    works.then_some(python)
}

fn script(python: &Path, arguments: &[&str]) -> String {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bags/write_bags.py");
    let output = Command::new(python).arg(script).args(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn entries(path: &Path) -> Vec<Entry> {
    Messages::open(path).unwrap().map(Result::unwrap).collect()
}

#[test]
fn bags_of_other_kinds_are_refused_by_name_with_the_remedy() {
    let folder = Folder::new("kinds");
    let file = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, bytes).unwrap();
        path.display().to_string()
    };
    let sqlite = ["ROS 2 bag in sqlite3", "ros2 bag convert", "mcap convert"];
    refused(&file("a/bag_0.db3", b"SQLite format 3\0rest"), &[], 3, &sqlite);
    refused(&folder.join("a").display().to_string(), &[], 3, &sqlite);
    file("b/metadata.yaml", b"rosbag2_bagfile_information:\n  storage_identifier: sqlite3\n");
    refused(&folder.join("b").display().to_string(), &[], 3, &sqlite);
    refused(&file("walk.bag", b"#ROSBAG V2.0\n"), &[], 3, &["a ROS 1 bag", "rosbags-convert"]);
    let listing = "  storage_identifier: mcap\n  compression_mode: FILE\n";
    file("c/metadata.yaml", listing.as_bytes());
    refused(&folder.join("c").display().to_string(), &[], 3, &["compression_mode FILE", "zstd -d"]);
    let listing = "  storage_identifier: mcap\n  relative_file_paths:\n    - gone_0.mcap\n";
    file("d/metadata.yaml", listing.as_bytes());
    refused(
        &folder.join("d").display().to_string(),
        &[],
        3,
        &["no file gone_0.mcap", "delete metadata.yaml"],
    );
    file("e/metadata.yaml", b"nothing");
    refused(&folder.join("e").display().to_string(), &[], 3, &["no relative_file_paths", "ros2 bag reindex"]);
    refused(&folder.join("gone.mcap").display().to_string(), &[], 3, &["gone.mcap", "give an .mcap file"]);
    refused(&file("noise.mcap", b"no mcap at all"), &[], 3, &["not an MCAP file"]);
}

#[test]
fn what_a_bag_does_not_say_is_asked_for() {
    let bag = |name: &str| format!("{BAGS}/{name}.mcap");
    refused(
        &bag("words"),
        &[],
        3,
        &["no depth and no scan", "/chatter (std_msgs/msg/String", "record the camera"],
    );
    refused(&bag("colour"), &[], 3, &["image encoding \"rgb8\"", "16UC1 or 32FC1", "not its colour"]);
    refused(&bag("xcdr2"), &[], 3, &["XCDR2 (encapsulation 00 07)", "/depth/image", "XCDR1"]);
    refused(
        &bag("ros1"),
        &[],
        3,
        &["message encoding \"ros1\"", "needed message encoding \"cdr\"", "ros2 bag convert"],
    );
    refused(&bag("no_info"), &[], 3, &["no camera_info", "--camera-info-topic", "--intrinsics fx,fy,cx,cy"]);
    refused(
        &bag("no_tf"),
        &[],
        3,
        &["no transforms from base_link to camera_optical_frame", "/tf_static", "--mount"],
    );
    refused(&bag("no_odometry"), &[], 3, &["no odometry topic", "--floor-fit", "record /odom or /tf"]);
    let two = [
        "2 topics that may be meant",
        "/camera/depth/image_rect_raw",
        "/rear/depth/image_raw",
        "--depth-topic",
    ];
    refused(&bag("two"), &[], 2, &two);
    refused(
        &bag("raw"),
        &["--depth-topic", "/nowhere"],
        2,
        &["no message on /nowhere", "give --depth-topic one of"],
    );
    refused(&bag("raw"), &["--depth-topic", "/odom"], 2, &["/odom is nav_msgs/msg/Odometry"]);
    refused(&bag("raw"), &["--mount", "1,2"], 2, &["--mount is 1,2", "FORWARD,LEFT,UP,PITCH"]);
    refused(&bag("raw"), &["--intrinsics", "1"], 2, &["--intrinsics has 1 numbers", "fx,fy,cx,cy"]);
    refused(&bag("raw"), &["--base-frame", "hull"], 3, &["no transforms from hull", "--base-frame"]);
}

#[test]
fn a_bag_that_was_cut_is_imported_as_far_as_it_goes_and_says_so() {
    let folder = Folder::new("cut");
    let whole = std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join(BAGS).join("raw.mcap")).unwrap();
    // Without its index and end mark everything is there; cut in its one chunk, nothing is.
    let part = folder.join("part");
    std::fs::create_dir(&part).unwrap();
    std::fs::copy(format!("{BAGS}/split/split_0.mcap"), part.join("part_0.mcap")).unwrap();
    let second = std::fs::read(format!("{BAGS}/split/split_1.mcap")).unwrap();
    std::fs::write(part.join("part_1.mcap"), &second[..1000]).unwrap();
    std::fs::write(folder.join("end.mcap"), &whole[..whole.len() - 8]).unwrap();
    for (source, frames) in [("end.mcap", 5), ("part", 3)] {
        let out = folder.join(&format!("{source}-out.mcap"));
        let outcome =
            run(&["import", &folder.join(source).display().to_string(), &out.display().to_string()]);
        assert_eq!(outcome.code, 3, "{}{}", outcome.out, outcome.err);
        assert!(outcome.out.contains(&format!("{frames} images")), "{}", outcome.out);
        assert!(outcome.out.contains("cut: "), "{}", outcome.out);
        assert!(outcome.err.contains("not all of the bag could be read"), "{}", outcome.err);
        assert_eq!(entries(&out).iter().filter(|entry| entry.topic == DEPTH.index).count(), frames);
    }
}

#[test]
fn an_imported_bag_plays() {
    let _alone = Alone::wait();
    let folder = Folder::new("bag-play");
    let out = folder.join("out.mcap").display().to_string();
    let imported = run(&["import", &format!("{BAGS}/moving.mcap"), &out]);
    assert_eq!(imported.code, 0, "{}", imported.err);
    assert!(imported.out.contains("camera_optical_frame moves in base_link"), "{}", imported.out);
    let (outcome, summary) = run_with_summary("bag", &["play", &out, "--set", "supervision.start_ms=60000"]);
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    assert!(summary["topics"]["local_map"]["sent"].as_u64().unwrap() >= 4, "{summary:#}");
}

fn frame_of(entry: &Entry) -> Option<Box<DepthFrame>> {
    let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
    entry.read_into(DEPTH, &mut frame).then_some(frame)
}

/// Compares two recordings of one walk: pixel for pixel, and every pose within rounding.
fn same_walk(ours: &Path, theirs: &Path) -> usize {
    let depth = |path: &Path| -> Vec<Entry> {
        Messages::open(path).unwrap().map(Result::unwrap).filter(|entry| entry.topic == DEPTH.index).collect()
    };
    let (ours_depth, theirs_depth) = (depth(ours), depth(theirs));
    assert_eq!(ours_depth.len(), theirs_depth.len());
    for (a, b) in ours_depth.iter().zip(&theirs_depth) {
        let (a, b) = (frame_of(a).unwrap(), frame_of(b).unwrap());
        assert!(a.pixels == b.pixels && (a.width, a.height) == (b.width, b.height), "{}", a.capture_ns);
        assert_eq!((a.fx_px, a.fy_px, a.cx_px, a.cy_px), (b.fx_px, b.fy_px, b.cx_px, b.cy_px));
        assert_eq!(a.capture_ns - ours_first(&ours_depth), b.capture_ns - ours_first(&theirs_depth));
        let (ra, rb) = (a.camera.rotation(), b.camera.rotation());
        let turned = (0..9).map(|i| (ra[i / 3][i % 3] - rb[i / 3][i % 3]).abs()).fold(0.0, f32::max);
        let moved = (0..3).map(|i| (a.camera.translation_m[i] - b.camera.translation_m[i]).abs());
        // Poses of the walk are written with six digits: their rotations are none beyond that.
        assert!(turned < 5e-6 && moved.fold(0.0, f32::max) < 1e-5, "{turned}: {:?} {:?}", a.camera, b.camera);
    }
    let odometry = |path: &Path| -> Vec<Odometry> {
        entries(path).iter().filter_map(|entry| entry.read(ODOMETRY)).collect()
    };
    let (a, b) = (odometry(ours), odometry(theirs));
    let first_ns = (a[0].stamp_ns, b[0].stamp_ns);
    let mut compared = 0;
    for (a, b) in a.iter().zip(&b) {
        if a.stamp_ns - first_ns.0 != b.stamp_ns - first_ns.1 {
            break;
        }
        assert!(a.pose.distance_m(&b.pose) < 1e-5, "{a:?} {b:?}");
        let turn = sidestep_msgs::wrap_angle(a.pose.yaw_rad - b.pose.yaw_rad).abs();
        assert!(turn < 1e-6, "{a:?} {b:?}");
        compared += 1;
    }
    assert!(compared + 12 > a.len(), "{compared} of {} poses compared", a.len());
    ours_depth.len()
}

fn ours_first(depth: &[Entry]) -> u64 {
    frame_of(&depth[0]).unwrap().capture_ns
}

fn import(source: &Path, out: &Path, options: &[&str]) -> Outcome {
    let (source, out) = (source.display().to_string(), out.display().to_string());
    let outcome = run(&[&["import", &source, &out], options].concat());
    assert_eq!(outcome.code, 0, "{source}: {}{}", outcome.out, outcome.err);
    outcome
}

/// Plays an import into the live graph, and replays what was recorded of that: nothing may differ.
fn plays_and_replays(import: &Path, folder: &Folder) {
    let recordings = folder.join("recordings").display().to_string();
    let file = import.display().to_string();
    let arguments =
        ["play", &file, "--lockstep", "--record", &recordings, "--set", "supervision.start_ms=60000"];
    let (outcome, summary) = run_with_summary("bag-played", &arguments);
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    let (outcome, report) =
        run_with_summary("bag-replayed", &["replay", summary["recording"].as_str().unwrap()]);
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    for node in report["nodes"].as_array().unwrap() {
        let counts = ["recorded", "compared", "differing"].map(|key| node[1][key].as_u64().unwrap());
        assert!(counts[0] > 50 && counts[1] == counts[0] && counts[2] == 0, "{}", outcome.out);
    }
}

/// Imports a folder of images, and the same as a bag in both forms of an image, and compares.
fn walk_in_bags(python: &Path, walk: &Path) {
    let folder = Folder::new("hololens-bag");
    let source = Source::open(&Options {
        folder: walk.to_path_buf(),
        metres_per_unit: 0.001,
        rate_hz: RATE_HZ.parse().unwrap(),
        intrinsics: None,
        placing: Placing::Poses { up: Up::Y, floor_m: None },
    })
    .unwrap();
    let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
    let raw = folder.join("pixels");
    let mut file = std::io::BufWriter::new(std::fs::File::create(&raw).unwrap());
    for image in 0..source.len() {
        source.depth(image, &mut frame).unwrap();
        file.write_all(bytemuck::cast_slice(frame.used_pixels())).unwrap();
    }
    file.flush().unwrap();
    let theirs = folder.join("folder.mcap");
    import(walk, &theirs, &["--rate", RATE_HZ]);
    let text = |path: &Path| path.display().to_string();
    let floor = source.floor_m().to_string();
    for form in ["compressed", "raw"] {
        let (bag, ours) = (folder.join(&format!("{form}.mcap")), folder.join(&format!("{form}-import.mcap")));
        let (walk, bag_text, raw) = (text(walk), text(&bag), text(&raw));
        let mut arguments = vec!["walk", &walk, RATE_HZ, &floor, &bag_text];
        if form == "raw" {
            arguments.push(&raw);
        }
        script(python, &arguments);
        let began_ns = sidestep_bus::host_ns();
        let outcome = import(&bag, &ours, &[]);
        let took_s = (sidestep_bus::host_ns() - began_ns) as f64 * 1e-9;
        let frames = same_walk(&ours, &theirs);
        plays_and_replays(&ours, &folder);
        let size_mb = |path: &Path| std::fs::metadata(path).unwrap().len() as f64 * 1e-6;
        println!(
            "{form}: {frames} frames, bag {:.1} MB, recording {:.1} MB, {took_s:.2} s\n{}",
            size_mb(&bag),
            size_mb(&ours),
            outcome.out
        );
    }
}

#[test]
fn the_hololens_walk_is_the_same_from_a_bag_as_from_its_folder_and_plays_and_replays() {
    let _alone = Alone::wait();
    let Some(python) = python("the HoloLens walk as a bag") else { return };
    walk_in_bags(&python, &Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/hololens"));
    let Some(data) = std::env::var_os("SIDESTEP_DATA") else {
        println!("skipped: SIDESTEP_DATA is not set (the whole HoloLens walk as a bag)");
        return;
    };
    walk_in_bags(&python, &PathBuf::from(data).join("depth_hololens"));
}

#[test]
fn an_independent_reader_decodes_every_message_of_an_export() {
    let _alone = Alone::wait();
    let Some(python) = python("reading an export") else { return };
    let folder = Folder::new("export");
    let recordings = folder.join("recordings").display().to_string();
    let (outcome, summary) = run_with_summary(
        "exported",
        &["run", "sim", "--for", "3s", "--record", &recordings, "--set", "supervision.start_ms=60000"],
    );
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    let bag = folder.join("drive");
    let exported = run(&["export", summary["recording"].as_str().unwrap(), &bag.display().to_string()]);
    assert_eq!(exported.code, 0, "{}{}", exported.out, exported.err);
    let listing = script(&python, &["read", &bag.join("drive_0.mcap").display().to_string()]);
    let count = |topic: &str| {
        let line = listing.lines().find(|line| line.starts_with(&format!("{topic} ")));
        line.and_then(|line| line.rsplit(' ').next()?.parse::<u64>().ok()).unwrap_or(0)
    };
    for (topic, least) in [
        ("/camera/depth/image_rect_raw", 60),
        ("/camera/depth/camera_info", 60),
        ("/odom", 200),
        ("/tf", 200),
        ("/tf_static", 1),
        ("/local_map", 60),
        ("/plan", 1),
        ("/cmd_vel", 200),
        ("/policy/cmd_vel", 60),
        ("/expert/cmd_vel", 60),
    ] {
        assert!(count(topic) >= least, "{topic}: {} of {least}\n{listing}", count(topic));
    }
    // And back again.
    let again = import(&bag, &folder.join("again.mcap"), &[]);
    assert!(
        again.out.contains(&format!("{} images", count("/camera/depth/image_rect_raw"))),
        "{}",
        again.out
    );
}

#[test]
fn every_real_bag_of_rosbag2_is_imported_or_refused_with_a_reason() {
    let Some(data) = std::env::var_os("SIDESTEP_DATA") else {
        println!("skipped: SIDESTEP_DATA is not set (bags of rosbag2)");
        return;
    };
    let mut folders = vec![PathBuf::from(data).join("mcap_rosbag2")];
    let mut sources = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap().flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|end| end == "mcap") {
                sources.extend([path, folder.clone()]);
            }
        }
    }
    sources.sort();
    sources.dedup();
    let out = Folder::new("rosbag2");
    for source in &sources {
        let outcome =
            run(&["import", &source.display().to_string(), &out.join("out.mcap").display().to_string()]);
        assert_eq!(outcome.code, 3, "{}: {}{}", source.display(), outcome.out, outcome.err);
        let reason =
            ["no depth and no scan", "message encoding"].iter().any(|text| outcome.err.contains(text));
        assert!(reason && outcome.err.contains("; "), "{}: {}", source.display(), outcome.err);
    }
    println!("{} files and folders", sources.len());
    assert!(sources.len() > 10);
}

//! Bags by an independent writer (tests/bags/write_bags.py), and our own bags read back.

use crate::{BagOptions, BagSummary, export_bag, import_bag};
use sidestep_msgs::{
    DEPTH, DepthFrame, Header, Isometry, LOCAL_MAP, LocalMap, Message, ODOMETRY, Odometry, Pose2, SCAN, Scan,
    Topic, Twist,
};
use sidestep_player::{Entry, Messages, PlayerError, read_foreign};
use sidestep_recorder::{BagWriter, Origin, Writer};
use std::path::{Path, PathBuf};

struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("sidestep-bags-{}-{name}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn golden(name: &str) -> BagOptions {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/bags");
    BagOptions { source: root.join(name), ..BagOptions::default() }
}

/// Imports a bag and returns all that came out of it.
fn imported(options: &BagOptions) -> (BagSummary, Vec<Entry>) {
    let name = options.source.file_name().unwrap().to_string_lossy().into_owned();
    let folder = Folder::new(&format!("{name}-{:?}", std::thread::current().id()));
    let summary = import_bag(options, &folder.0.join("out.mcap")).unwrap();
    let entries = Messages::open(&summary.path).unwrap().map(Result::unwrap).collect();
    (summary, entries)
}

fn frames(entries: &[Entry]) -> Vec<Box<DepthFrame>> {
    let read = |entry: &Entry| {
        let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
        entry.read_into(DEPTH, &mut frame).then_some(frame)
    };
    entries.iter().filter_map(read).collect()
}

/// The picture of write_bags.py.
fn pixel(frame: usize, row: usize, col: usize) -> u16 {
    if col.is_multiple_of(7) { 0 } else { (1000 + 100 * frame + 10 * row + col) as u16 }
}

fn same_pose(a: &Isometry, b: &Isometry) -> bool {
    let turn = |pose: &Isometry| pose.rotation();
    let (ra, rb) = (turn(a), turn(b));
    (0..9).all(|i| (ra[i / 3][i % 3] - rb[i / 3][i % 3]).abs() < 1e-6)
        && (0..3).all(|i| (a.translation_m[i] - b.translation_m[i]).abs() < 1e-5)
}

#[test]
fn every_kind_of_depth_image_gives_the_same_pixels_camera_and_poses() {
    for name in ["raw.mcap", "big_endian.mcap", "float.mcap", "png.mcap", "inverse.mcap", "rvl.mcap", "split"]
    {
        let (summary, entries) = imported(&golden(name));
        assert_eq!((summary.frames, summary.damage.len()), (5, 0), "{name}: {summary:?}");
        for (number, frame) in frames(&entries).iter().enumerate() {
            assert_eq!((frame.width, frame.height, frame.metres_per_unit), (32, 24, 0.001), "{name}");
            let k = (frame.fx_px, frame.fy_px, frame.cx_px, frame.cy_px);
            assert_eq!(k, (30.0, 31.0, 15.5, 11.5), "{name}");
            assert!(
                same_pose(&frame.camera, &Isometry::camera(0.1, 0.02, 0.5, 0.0)),
                "{name}: {:?}",
                frame.camera
            );
            assert_eq!(frame.capture_ns, 1_000_000_000 + number as u64 * 100_000_000, "{name}");
            for (at, &value) in frame.used_pixels().iter().enumerate() {
                let wanted = pixel(number, at / 32, at % 32);
                // Quantised inverse depth keeps depth to a part of 10100 of its square.
                let off =
                    if name == "inverse.mcap" { (f64::from(wanted).powi(2) * 1e-7).ceil() as u16 } else { 0 };
                assert!(
                    value.abs_diff(wanted) <= off && (value == 0) == (wanted == 0),
                    "{name} {at}: {value}"
                );
            }
        }
        let odometry: Vec<Odometry> = entries.iter().filter_map(|entry| entry.read(ODOMETRY)).collect();
        assert_eq!(odometry.len(), 25, "{name}: 50 Hz is kept as it is");
        for sample in &odometry {
            let at_s = (sample.stamp_ns - 1_000_000_000) as f64 * 1e-9;
            let pose = Pose2::new(0.5 * at_s, -0.2 * at_s, 0.3 * at_s);
            assert!(
                sample.pose.distance_m(&pose) < 1e-9 && (sample.pose.yaw_rad - pose.yaw_rad).abs() < 1e-9
            );
            assert!((sample.twist.v_m_s - 0.5).abs() < 1e-6 && sample.pose_epoch == 0, "{sample:?}");
        }
    }
}

#[test]
fn when_a_frame_arrives_the_odometry_around_its_capture_has_arrived() {
    let (_, entries) = imported(&golden("raw.mcap"));
    let (mut newest_ns, mut last_now_ns, mut seen) = (0, 0, 0);
    for entry in &entries {
        newest_ns = entry.read(ODOMETRY).map_or(newest_ns, |odometry| odometry.stamp_ns);
        assert!(entry.header.now_ns >= last_now_ns, "{:?}", entry.header.now_ns);
        last_now_ns = entry.header.now_ns;
        if entry.topic == DEPTH.index {
            let frame = &frames(std::slice::from_ref(entry))[0];
            assert!(newest_ns >= frame.capture_ns, "{newest_ns} before {}", frame.capture_ns);
            assert!(entry.header.now_ns >= frame.capture_ns + 20_000_000);
            // Wall time of the recording is that of the bag.
            assert_eq!(entry.logged_ns - entry.header.now_ns, 1_700_000_000_000_000_000 - 1_000_000_000);
            seen += 1;
        }
    }
    assert_eq!(seen, 5);
}

#[test]
fn a_camera_that_moves_has_a_pose_per_frame_and_transforms_give_the_odometry() {
    let (summary, entries) = imported(&golden("moving.mcap"));
    assert!(summary.text().contains("camera_optical_frame moves in base_link"), "{}", summary.text());
    for (number, frame) in frames(&entries).iter().enumerate() {
        let up_m = 0.5 + 0.01 * number as f32;
        assert!(same_pose(&frame.camera, &Isometry::camera(0.1, 0.02, up_m, 0.0)), "{:?}", frame.camera);
    }
    let odometry: Vec<Odometry> = entries.iter().filter_map(|entry| entry.read(ODOMETRY)).collect();
    assert_eq!(odometry.len(), 25);
    let (at, speed) = (odometry[10].pose, odometry[10].twist);
    assert!((at.x_m - 0.1).abs() < 1e-9 && (speed.w_rad_s - 0.3).abs() < 1e-5, "{:?}", odometry[10]);
}

#[test]
fn a_large_image_is_reduced_to_the_valid_pixels_and_its_camera_with_it() {
    let (summary, entries) = imported(&golden("large.mcap"));
    assert!(summary.text().contains("848 x 480 reduced to 424 x 240"), "{}", summary.text());
    let frames = frames(&entries);
    let frame = &frames[0];
    assert_eq!((frame.width, frame.height, frame.fx_px, frame.cx_px), (424, 240, 210.0, 211.5));
    for (at, &value) in frame.used_pixels().iter().enumerate() {
        assert_eq!(value as usize, 2000 + at / 424, "one valid pixel in four is enough");
    }
}

#[test]
fn a_bag_with_a_lidar_alone_gives_sweeps() {
    let (summary, entries) = imported(&golden("scan.mcap"));
    assert_eq!((summary.frames, summary.sweeps), (0, 5));
    let scan: Scan = entries.iter().find_map(|entry| entry.read(SCAN)).unwrap();
    assert_eq!((scan.count, scan.first_rad, scan.near_m, scan.far_m), (93, -1.0, 0.1, 12.0));
    assert!((scan.height_m - 0.5).abs() < 1e-6 && (scan.sensor.x_m - 0.1).abs() < 1e-9);
    assert!(
        (scan.range_m[89] - 1.89).abs() < 1e-6 && scan.range_m[90].is_infinite() && scan.range_m[91].is_nan()
    );
    assert!(scan.range_m[92].is_nan(), "nearer than can be measured is no measurement");
}

#[test]
fn what_a_bag_lacks_an_option_can_say() {
    let mount = Some(Isometry::camera(0.2, 0.0, 0.6, 0.1));
    let (_, entries) = imported(&BagOptions { mount, ..golden("no_tf.mcap") });
    assert_eq!(frames(&entries)[0].camera, Isometry::camera(0.2, 0.0, 0.6, 0.1));
    let intrinsics = Some(sidestep_import::Intrinsics { fx_px: 40.0, fy_px: 40.0, cx_px: 16.0, cy_px: 12.0 });
    let (_, entries) = imported(&BagOptions { intrinsics, ..golden("no_info.mcap") });
    let frame = &frames(&entries)[0];
    assert_eq!((frame.fx_px, frame.cx_px), (40.0, 16.0));
    let depth_topic = Some("/rear/depth/image_raw".into());
    let camera_info_topic = Some("/camera/depth/camera_info".into());
    let (summary, _) = imported(&BagOptions { depth_topic, camera_info_topic, ..golden("two.mcap") });
    assert!(summary.text().contains("depth: /rear/depth/image_raw"), "{}", summary.text());
    // A sheet of pixels that slants is no floor: nothing is made up.
    let (summary, _) = imported(&BagOptions { floor_fit: Some(1), ..golden("no_odometry.mcap") });
    assert_eq!(summary.frames, 0);
    assert!(summary.text().contains("5 frames left out"), "{}", summary.text());
    let (summary, entries) = imported(&BagOptions { arrival_stamps: true, ..golden("raw.mcap") });
    assert_eq!(summary.frames, 5);
    // Odometry took 2 ms to arrive, depth 15 ms.
    assert_eq!(frames(&entries)[0].capture_ns, 1_000_000_000 + 13_000_000);
}

/// Writes one message as a node would have.
fn put<M: Message>(
    writer: &mut Writer<sidestep_recorder::DiskFile>,
    topic: Topic<M>,
    now_ns: u64,
    message: &M,
) {
    let header = Header { now_ns, ..Header::default() };
    writer.write(topic.row(), &header, bytemuck::bytes_of(message), now_ns).unwrap();
}

/// A recording with a camera that nods or not.
fn recording(path: &Path, nods: bool, metres_per_unit: f32) -> PathBuf {
    let origin = Origin { mono_to_wall_ns: 1_600_000_000_000_000_000, ..Origin::default() };
    let mut writer = Writer::create(path, &origin).unwrap();
    let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
    (frame.width, frame.height, frame.metres_per_unit) = (64, 48, metres_per_unit);
    (frame.fx_px, frame.fy_px, frame.cx_px, frame.cy_px) = (60.0, 61.0, 31.5, 23.5);
    let mut map: Box<LocalMap> = bytemuck::allocation::zeroed_box();
    map.age.fill(255);
    for step in 0..100u64 {
        let stamp_ns = 5_000_000_000 + 10_000_000 * step;
        let pose = Pose2::new(0.01 * step as f64, 0.003 * step as f64, 3.1 + 0.01 * step as f64);
        let pose = Pose2 { yaw_rad: sidestep_msgs::wrap_angle(pose.yaw_rad), ..pose };
        let (roll_rad, pitch_rad) = (0.02, -0.01);
        let twist = Twist::new(1.0, 1.0);
        put(
            &mut writer,
            ODOMETRY,
            stamp_ns,
            &Odometry { stamp_ns, pose, twist, roll_rad, pitch_rad, ..Odometry::default() },
        );
        if step % 10 == 5 {
            let pitch = if nods { 0.01 * step as f32 } else { 0.2 };
            frame.capture_ns = stamp_ns - 5_000_000;
            frame.camera = Isometry::camera(0.1, 0.0, 0.55, pitch);
            for (at, pixel) in frame.pixels[..64 * 48].iter_mut().enumerate() {
                *pixel = (at as u64 * 7919 % 6000 + step) as u16;
            }
            put(&mut writer, DEPTH, stamp_ns + 22_000_000, &*frame);
            map.capture_ns = frame.capture_ns;
            put(&mut writer, LOCAL_MAP, stamp_ns + 23_000_000, &*map);
        }
    }
    writer.complete(&[]).unwrap()
}

#[test]
fn an_export_that_is_imported_again_has_the_same_pixels_camera_and_poses() {
    let folder = Folder::new("round");
    for (name, nods, unit) in [("fixed", false, 0.001), ("nods", true, 0.001), ("unit", false, 0.0005)] {
        let made = recording(&folder.0.join(format!("{name}.mcap")), nods, unit);
        let bag = folder.0.join(name);
        let exported = export_bag(&made, &bag).unwrap();
        assert_eq!(exported.totals.messages["/odom"], 100);
        let listing = std::fs::read_to_string(bag.join("metadata.yaml")).unwrap();
        assert!(
            listing.contains(&format!("- {name}_0.mcap")) && listing.contains("storage_identifier: mcap")
        );
        assert!(export_bag(&made, &bag).unwrap_err().to_string().contains("does not exist yet"));
        let (summary, entries) = imported(&BagOptions { source: bag, ..BagOptions::default() });
        assert_eq!((summary.frames, summary.damage.len()), (10, 0), "{summary:?}");
        let before: Vec<Entry> = Messages::open(&made).unwrap().map(Result::unwrap).collect();
        let shift_ns = 4_000_000_000;
        for (a, b) in frames(&before).iter().zip(&frames(&entries)) {
            assert_eq!(a.capture_ns, b.capture_ns + shift_ns, "{name}");
            let wanted = |pixel: u16| (f64::from(pixel) * f64::from(unit) * 1000.0).round();
            let same = |(a, b): (&u16, &u16)| {
                (wanted(*a) - f64::from(*b)).abs() <= if unit < 0.001 { 1.0 } else { 0.0 }
            };
            assert!(a.used_pixels().iter().zip(b.used_pixels()).all(same), "{name}");
            assert_eq!((a.fx_px, a.fy_px, a.cx_px, a.cy_px), (b.fx_px, b.fy_px, b.cx_px, b.cy_px));
            assert!(same_pose(&a.camera, &b.camera), "{name}: {:?} {:?}", a.camera, b.camera);
        }
        let odometry = |entries: &[Entry]| -> Vec<Odometry> {
            entries.iter().filter_map(|entry| entry.read(ODOMETRY)).collect()
        };
        let (a, b) = (odometry(&before), odometry(&entries));
        assert_eq!((a.len(), b.len()), (100, 100));
        for (a, b) in a.iter().zip(&b) {
            let turn = sidestep_msgs::wrap_angle(a.pose.yaw_rad - b.pose.yaw_rad).abs();
            assert!(a.pose.distance_m(&b.pose) < 1e-9 && turn < 1e-9 && a.stamp_ns == b.stamp_ns + shift_ns);
            assert!((a.roll_rad - b.roll_rad).abs() < 1e-6 && (a.pitch_rad - b.pitch_rad).abs() < 1e-6);
            assert_eq!(a.twist, b.twist);
        }
    }
}

/// SplitMix64.
fn draw(seed: &mut u64) -> u64 {
    *seed = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *seed;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Copies a bag, and in every fourth message changes a byte, a length or the end.
fn damaged(source: &Path, out: &Path, seed: &mut u64) {
    let mut writer = BagWriter::create(out).unwrap();
    let mut topics = std::collections::BTreeMap::new();
    read_foreign(source, |channel, message| {
        let (mut data, mut logged_ns) = (message.data.to_vec(), message.logged_ns);
        let topic = *topics
            .entry(channel.id)
            .or_insert_with(|| writer.topic(&channel.topic, (&channel.schema, ""), "").unwrap());
        let at = draw(seed) as usize % data.len();
        match draw(seed) % 16 {
            0 => data[at] ^= draw(seed) as u8,
            1 => data.truncate(at),
            2 => data.iter_mut().skip(at & !3).take(4).for_each(|byte| *byte = 0xff),
            3 => logged_ns = draw(seed),
            _ => {}
        }
        writer.write(topic, [logged_ns, logged_ns], &data).unwrap();
        Ok::<(), PlayerError>(())
    })
    .unwrap();
    writer.finish().unwrap();
}

#[test]
fn a_bag_whose_messages_are_damaged_is_imported_in_part_or_refused() {
    let folder = Folder::new("damaged");
    let (mut whole, mut parts, mut refused) = (0, 0, 0);
    for name in ["raw", "png", "rvl", "inverse", "moving", "scan"] {
        for number in 0..25 {
            let mut seed = number;
            let bag = folder.0.join(format!("{name}-{number}.mcap"));
            damaged(&golden(&format!("{name}.mcap")).source, &bag, &mut seed);
            let arrival_stamps = number % 2 == 1;
            let options = BagOptions { source: bag, arrival_stamps, ..BagOptions::default() };
            match import_bag(&options, &folder.0.join("out.mcap")) {
                Ok(summary) if summary.damage.is_empty() => whole += 1,
                Ok(_) => parts += 1,
                Err(error) => {
                    assert!(error.to_string().contains("; "), "{error}");
                    refused += 1;
                }
            }
        }
    }
    println!("{whole} whole, {parts} in part, {refused} refused");
    assert!(parts > 10 && refused > 10);
}

//! A folder becomes the messages that it says; a wrong folder an error that says what to do.

use crate::{ImportError, Intrinsics, Options, Placing, Source, Up, import_folder};
use sidestep_msgs::{DEPTH, DepthFrame, ODOMETRY, PATH, Path as WayPath};
use sidestep_player::Messages;
use std::fmt::Write as _;
use std::path::PathBuf;

struct Folder(PathBuf);

impl Folder {
    /// `count` images of 64 x 48 whose pixel i has the value number + i, cameras level and 1.2 m above z = 0, walking
    /// 0.1 m per image along x and looking along y.
    fn new(name: &str, count: u64) -> Self {
        let folder = std::env::temp_dir().join(format!("sidestep-import-{}-{name}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(folder.join("depth")).unwrap();
        let mut poses = String::new();
        for number in 0..count {
            let pixels: Vec<u16> = (0..64 * 48).map(|i| number as u16 + i).collect();
            png(&folder.join(format!("depth/{number:05}.png")), 64, 48, png::BitDepth::Sixteen, &pixels);
            // Optical axes in the world: x right = +x, y down = -z, z forward = +y.
            writeln!(poses, "1 0 0 {} 0 0 1 0.5 0 -1 0 1.2 0 0 0 1", number as f64 * 0.1).unwrap();
        }
        std::fs::write(folder.join("poses.txt"), poses).unwrap();
        std::fs::write(folder.join("K.txt"), "50 0 32\n0 50 24\n0 0 1\n").unwrap();
        Self(folder)
    }

    fn options(&self) -> Options {
        Options {
            folder: self.0.clone(),
            metres_per_unit: 0.001,
            rate_hz: 10.0,
            intrinsics: None,
            placing: Placing::Poses { up: Up::Z, floor_m: Some(0.0) },
        }
    }

    fn refused(&self) -> String {
        let error = Source::open(&self.options()).and_then(|source| {
            let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
            source.depth(0, &mut frame).map(|_| ())
        });
        let error = error.unwrap_err();
        let text = error.to_string();
        assert!(matches!(error, ImportError::Read { .. } | ImportError::Content { .. }), "{text}");
        assert!(text.contains(&*self.0.to_string_lossy()), "no path in: {text}");
        text
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn png(path: &std::path::Path, width: u32, height: u32, depth: png::BitDepth, pixels: &[u16]) {
    let mut encoder = png::Encoder::new(std::fs::File::create(path).unwrap(), width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(depth);
    let bytes: Vec<u8> = match depth {
        png::BitDepth::Sixteen => pixels.iter().flat_map(|pixel| pixel.to_be_bytes()).collect(),
        _ => pixels.iter().map(|&pixel| pixel as u8).collect(),
    };
    encoder.write_header().unwrap().write_image_data(&bytes).unwrap();
}

#[test]
fn images_come_with_their_camera_and_odometry_runs_through_their_poses() {
    let folder = Folder::new("poses", 20);
    let source = Source::open(&folder.options()).unwrap();
    let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
    assert!(source.depth(7, &mut frame).unwrap());
    assert_eq!((frame.width, frame.height, frame.pixels[100], frame.pixels[64 * 48]), (64, 48, 107, 0));
    assert!((frame.camera.translation_m[2] - 1.2).abs() < 1e-6, "{:?}", frame.camera);
    // Level and looking ahead: what the robot file would say of a level camera.
    let level = sidestep_msgs::Isometry::camera(0.0, 0.0, 1.2, 0.0).rotation();
    assert_eq!(
        frame.camera.rotation().map(|row| row.map(|x| (x * 1e5).round())),
        level.map(|row| row.map(|x| (x * 1e5).round()))
    );

    let odometry = source.odometry();
    let at = |stamp_ns| *odometry.iter().find(|odometry| odometry.stamp_ns == stamp_ns).unwrap();
    let (exact, between) = (at(source.capture_ns(7)), at(source.capture_ns(7) + 50_000_000));
    assert!(exact.pose.distance_m(&source.base(7)) < 1e-12);
    assert!(
        (between.pose.x_m - 0.75).abs() < 1e-9
            && (between.pose.yaw_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-5,
        "{between:?}"
    );
    assert!(odometry.windows(2).all(|pair| pair[1].stamp_ns - pair[0].stamp_ns == 10_000_000));
    // Looking along y while walking along x: sideways, no speed ahead.
    assert!(between.twist.v_m_s.abs() < 1e-6 && between.pose_epoch == 0);

    let mut way = Box::new(WayPath::default());
    source.path(&mut way);
    assert!(
        way.count >= 6 && (way.points[1].x_m - 0.3).abs() < 1e-6 && (way.points[1].y_m - 0.5).abs() < 1e-6,
        "{:?}",
        way.points[1]
    );
}

#[test]
fn a_recording_holds_the_folder_with_odometry_ahead_of_each_image() {
    let folder = Folder::new("recording", 12);
    let summary = import_folder(&folder.options(), &folder.0.join("out.mcap")).unwrap();
    assert_eq!((summary.images, summary.unplaced), (12, 0));
    assert!(
        (summary.distance_m - 1.1).abs() < 1e-9 && (summary.duration_s - 1.1).abs() < 1e-9,
        "{summary:?}"
    );
    let source = Source::open(&folder.options()).unwrap();
    let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
    let (mut images, mut newest_ns, mut paths) = (0, 0, 0);
    for entry in Messages::open(&summary.path).unwrap().map(Result::unwrap) {
        paths += usize::from(entry.topic == PATH.index);
        if let Some(odometry) = entry.read(ODOMETRY) {
            newest_ns = odometry.stamp_ns;
        }
        if entry.topic == DEPTH.index {
            source.depth(images, &mut frame).unwrap();
            assert_eq!(entry.message, bytemuck::bytes_of(&*frame));
            assert!(newest_ns >= frame.capture_ns && entry.header.source_frame == images as u64 + 1);
            images += 1;
        }
    }
    assert_eq!((images, paths), (12, 1));
}

#[test]
fn without_poses_each_image_is_an_epoch_and_one_without_a_floor_is_left_out() {
    let folder = Folder::new("fit", 5);
    let placing = Placing::FloorFit { seed: 1 };
    let source = Source::open(&Options { placing, ..folder.options() }).unwrap();
    let odometry = source.odometry();
    for image in 0..5 {
        let at = odometry.iter().find(|odometry| odometry.stamp_ns == source.capture_ns(image)).unwrap();
        assert_eq!((at.pose_epoch, at.pose), (image as u32 + 1, sidestep_msgs::Pose2::ORIGIN));
    }
    let summary =
        import_folder(&Options { placing, ..folder.options() }, &folder.0.join("out.mcap")).unwrap();
    assert_eq!((summary.images, summary.unplaced), (0, 5), "a slanted sheet of pixels is no floor");
}

#[test]
fn what_is_wrong_with_a_folder_is_said_with_what_is_needed() {
    let folder = Folder::new("errors", 3);
    std::fs::remove_file(folder.0.join("K.txt")).unwrap();
    assert!(folder.refused().contains("K.txt"));
    for matrix in ["1 2 3", "50 0 32 0 50 24 0 0 1 9", "0 0 0 0 0 0 0 0 0", "a b c d e f g h i"] {
        std::fs::write(folder.0.join("K.txt"), matrix).unwrap();
        assert!(folder.refused().contains("nine numbers"), "{matrix}");
    }
    std::fs::write(folder.0.join("K.txt"), "50 0 32 0 50 24 0 0 1").unwrap();
    let poses = std::fs::read_to_string(folder.0.join("poses.txt")).unwrap();
    std::fs::write(folder.0.join("poses.txt"), poses.lines().next().unwrap()).unwrap();
    let text = folder.refused();
    assert!(text.contains("1 poses") && text.contains("3, one per image"), "{text}");
    std::fs::write(folder.0.join("poses.txt"), poses.replace("1 0 0", "2 0 0")).unwrap();
    assert!(folder.refused().contains("line 1"));
    std::fs::write(folder.0.join("poses.txt"), poses).unwrap();

    let image = folder.0.join("depth/00000.png");
    png(&image, 64, 48, png::BitDepth::Eight, &[0; 64 * 48]);
    let text = folder.refused();
    assert!(text.contains("Eight") && text.contains("16-bit"), "{text}");
    png(&image, 800, 600, png::BitDepth::Sixteen, &[0; 800 * 600]);
    assert!(folder.refused().contains("800 x 600"));
    std::fs::write(&image, b"no png").unwrap();
    assert!(folder.refused().contains("00000.png"));
    std::fs::rename(&image, folder.0.join("depth/first.png")).unwrap();
    assert!(folder.refused().contains("a number as name"));
    std::fs::remove_dir_all(folder.0.join("depth")).unwrap();
    assert!(folder.refused().contains("no PNG"));
}

#[test]
fn given_intrinsics_replace_the_file() {
    let folder = Folder::new("focal", 2);
    std::fs::remove_file(folder.0.join("K.txt")).unwrap();
    let intrinsics = Some(Intrinsics { fx_px: 384.0, fy_px: 384.0, cx_px: 320.0, cy_px: 240.0 });
    assert!(Source::open(&Options { intrinsics, ..folder.options() }).is_ok());
}

#[test]
fn the_floor_of_the_hololens_walk_is_found_where_it_was_measured() {
    let Ok(data) = std::env::var("SIDESTEP_DATA") else {
        println!("skipped: SIDESTEP_DATA is not set (floor of the HoloLens walk)");
        return;
    };
    let source = Source::open(&Options {
        folder: PathBuf::from(data).join("depth_hololens"),
        metres_per_unit: 0.001,
        rate_hz: 10.0,
        intrinsics: None,
        placing: Placing::Poses { up: Up::Y, floor_m: None },
    })
    .unwrap();
    println!("floor at {:.3} m, {} images", source.floor_m(), source.len());
    assert!((source.floor_m() + 1.53).abs() < 0.02, "{}", source.floor_m());
}

#[test]
fn every_image_of_the_aims_robot_shows_its_floor() {
    let Ok(data) = std::env::var("SIDESTEP_DATA") else {
        println!("skipped: SIDESTEP_DATA is not set (floor of the AIMS images)");
        return;
    };
    let source = Source::open(&Options {
        folder: PathBuf::from(data).join("depth_aims"),
        metres_per_unit: 0.001,
        rate_hz: 10.0,
        intrinsics: Some(Intrinsics { fx_px: 384.0, fy_px: 384.0, cx_px: 320.0, cy_px: 240.0 }),
        placing: Placing::FloorFit { seed: 1 },
    })
    .unwrap();
    let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
    let mut heights = Vec::new();
    for image in 0..source.len() {
        assert!(source.depth(image, &mut frame).unwrap(), "no floor in image {image}");
        heights.push(frame.camera.translation_m[2]);
    }
    for (image, height) in heights.iter().enumerate().step_by(20) {
        println!("image {image}: camera {height:.3} m above the floor");
    }
    assert!(heights.iter().all(|height| (0.55..0.9).contains(height)), "{heights:?}");
}

//! The files of a folder: depth images, intrinsics, poses.

use crate::error::ImportError;
use sidestep_msgs::DepthFrame;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

const DEPTH_REMEDY: &str = "export depth as 16-bit greyscale PNG of at most 640 x 480";

/// A pinhole camera without distortion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// `[px]` focal length along x.
    pub fx_px: f64,
    /// `[px]` focal length along y.
    pub fy_px: f64,
    /// `[px]` principal point, column.
    pub cx_px: f64,
    /// `[px]` principal point, row.
    pub cy_px: f64,
}

/// One depth image of a folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Image {
    /// Its number, from its name.
    pub(crate) number: u64,
    pub(crate) path: PathBuf,
}

/// The images `NUMBER.png` of `folder/depth`, or of the folder itself, by number.
pub(crate) fn images(folder: &Path) -> Result<Vec<Image>, ImportError> {
    let within = folder.join("depth");
    let folder = if within.is_dir() { within } else { folder.to_path_buf() };
    let remedy = "give a folder with NUMBER.png depth images or with a folder depth in it, or a ROS 2 bag (an .mcap file, or a folder with metadata.yaml)";
    let fault = |source| ImportError::Read { path: folder.clone(), source, remedy };
    let mut images = Vec::new();
    for entry in std::fs::read_dir(&folder).map_err(fault)? {
        let path = entry.map_err(fault)?.path();
        if path.extension().is_none_or(|end| end != "png") {
            continue;
        }
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let number = stem.parse().map_err(|_| {
            ImportError::content(
                &path,
                format!("the name {stem}"),
                "a number as name",
                "number the images in order",
            )
        })?;
        images.push(Image { number, path });
    }
    images.sort_by_key(|image| image.number);
    if images.is_empty() {
        return Err(ImportError::content(&folder, "no PNG", "depth images NUMBER.png", remedy));
    }
    Ok(images)
}

fn text(path: &Path, remedy: &'static str) -> Result<String, ImportError> {
    std::fs::read_to_string(path).map_err(|source| ImportError::Read {
        path: path.to_path_buf(),
        source,
        remedy,
    })
}

/// The finite numbers of a text.
fn numbers(text: &str) -> Option<Vec<f64>> {
    let parsed: Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
    parsed.ok().filter(|numbers| numbers.iter().all(|number| number.is_finite()))
}

/// Intrinsics from a 3 x 3 matrix in `K.txt`.
pub(crate) fn intrinsics(folder: &Path) -> Result<Intrinsics, ImportError> {
    let path = folder.join("K.txt");
    let remedy = "write fx 0 cx / 0 fy cy / 0 0 1 into K.txt, or give --intrinsics";
    let content = text(&path, remedy)?;
    let needed = "nine numbers, fx 0 cx 0 fy cy 0 0 1, with positive focal lengths";
    let wrong = |found: String| ImportError::content(&path, found, needed, remedy);
    let matrix = numbers(&content).ok_or_else(|| wrong("something that is no finite number".into()))?;
    let [fx_px, skew, cx_px, zero, fy_px, cy_px, ..] = matrix[..] else {
        return Err(wrong(format!("{} numbers", matrix.len())));
    };
    if matrix.len() != 9 || !(fx_px > 1.0 && fy_px > 1.0) || skew.abs() > 1e-6 || zero.abs() > 1e-6 {
        return Err(wrong(format!("{matrix:?}")));
    }
    Ok(Intrinsics { fx_px, fy_px, cx_px, cy_px })
}

/// A rigid transform as rotation rows and translation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rigid {
    pub(crate) rotation: [[f64; 3]; 3],
    pub(crate) translation_m: [f64; 3],
}

/// Camera-to-world poses from the lines of `poses.txt`, one 4 x 4 matrix per image.
pub(crate) fn poses(folder: &Path, count: usize) -> Result<Vec<Rigid>, ImportError> {
    let path = folder.join("poses.txt");
    let remedy =
        "write one line of 16 numbers (4 x 4 camera-to-world, row by row) per image, or use the floor fit";
    let content = text(&path, remedy)?;
    let lines: Vec<&str> = content.lines().filter(|line| !line.trim().is_empty()).collect();
    if lines.len() != count {
        let (found, needed) = (format!("{} poses", lines.len()), format!("{count}, one per image"));
        return Err(ImportError::content(&path, found, needed, remedy));
    }
    let pose = |(line, text): (usize, &&str)| {
        numbers(text).and_then(|matrix| rigid(&matrix)).ok_or_else(|| {
            let needed = "16 finite numbers whose upper left 3 x 3 is a rotation";
            ImportError::content(&path, format!("line {} is not one", line + 1), needed, remedy)
        })
    };
    lines.iter().enumerate().map(pose).collect()
}

/// A 4 x 4 matrix as a rigid transform; `None` where it is not one.
fn rigid(matrix: &[f64]) -> Option<Rigid> {
    let row = |i: usize| matrix.get(4 * i..4 * i + 3)?.try_into().ok();
    let rotation: [[f64; 3]; 3] = [row(0)?, row(1)?, row(2)?];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let orthonormal = (0..3)
        .all(|i| (0..=i).all(|j| (dot(rotation[i], rotation[j]) - f64::from(u8::from(i == j))).abs() < 0.01));
    let [a, b, c] = rotation;
    let volume = dot([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]], c);
    let is_rigid = matrix.len() == 16 && orthonormal && volume > 0.0;
    is_rigid.then_some(Rigid { rotation, translation_m: [matrix[3], matrix[7], matrix[11]] })
}

/// Reads an image into the pixels of a frame, and sets its size.
pub(crate) fn read_pixels(path: &Path, frame: &mut DepthFrame) -> Result<(), ImportError> {
    let file = File::open(path).map_err(|source| ImportError::Read {
        path: path.to_path_buf(),
        source,
        remedy: DEPTH_REMEDY,
    })?;
    let broken = |error: png::DecodingError| {
        ImportError::content(path, error.to_string(), "a whole PNG", "copy or export the file again")
    };
    let mut reader = png::Decoder::new(BufReader::new(file)).read_info().map_err(broken)?;
    let info = reader.info();
    let (width, height) = (info.width, info.height);
    let is_depth = info.color_type == png::ColorType::Grayscale && info.bit_depth == png::BitDepth::Sixteen;
    let fits = (16..=640).contains(&width) && (16..=480).contains(&height);
    if !is_depth || !fits || info.interlaced {
        let found = format!("{width} x {height} {:?} {:?}", info.color_type, info.bit_depth);
        let needed = "16-bit greyscale of 16 x 16 to 640 x 480, not interlaced";
        return Err(ImportError::content(path, found, needed, DEPTH_REMEDY));
    }
    (frame.width, frame.height) = (width, height);
    let used = width as usize * height as usize;
    frame.pixels[used..].fill(0);
    for row in frame.pixels[..used].chunks_exact_mut(width as usize) {
        let bytes = reader.next_row().map_err(broken)?;
        let bytes = bytes.as_ref().map(|row| row.data()).unwrap_or_default();
        for (pixel, pair) in row.iter_mut().zip(bytes.chunks_exact(2)) {
            *pixel = u16::from_be_bytes([pair[0], pair[1]]);
        }
    }
    Ok(())
}

//! Depth images of ROS into pixels of millimetres, and large ones into the room of a depth frame.

use crate::messages::{CompressedImage, Image};
use crate::rvl;
use sidestep_msgs::DepthFrame;

/// `[px]` no camera has more columns or rows; a file that claims more is damaged, and memory stays bounded.
const SIDE_MAX: usize = 4096;
/// Columns and rows that a depth frame has room for, and fewest.
const ROOM: (usize, usize) = (640, 480);
const SIDE_MIN: usize = 16;
/// `[m]` one unit of an imported pixel, as REP-118 has it for 16UC1.
pub(crate) const METRES_PER_UNIT: f32 = 0.001;
/// `[byte]` before the image of a compressed depth message: an enum and two numbers of quantisation.
const CONFIGURATION: usize = 12;

/// Whether an encoding of `sensor_msgs/Image` is depth beyond doubt.
pub(crate) fn is_depth(encoding: &str) -> bool {
    ["16UC1", "32FC1"].contains(&encoding)
}

/// Encodings that can be read, if a person says that they are depth.
pub(crate) fn is_readable(encoding: &str) -> bool {
    is_depth(encoding) || encoding == "mono16"
}

/// An image of any size; 0 = no measurement.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Raster {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) millimetres: Vec<u16>,
}

/// Millimetres of a distance; NaN, infinite and what no pixel can say are no measurement.
fn millimetres(metres: f32) -> u16 {
    let rounded = libm::roundf(metres * 1000.0);
    if rounded > 0.0 && rounded < f32::from(u16::MAX) { rounded as u16 } else { 0 }
}

impl Raster {
    fn resize(&mut self, width: usize, height: usize) -> Result<(), String> {
        let sides = SIDE_MIN..=SIDE_MAX;
        if !(sides.contains(&width) && sides.contains(&height)) {
            return Err(format!("an image of {width} x {height}"));
        }
        (self.width, self.height) = (width, height);
        self.millimetres.clear();
        self.millimetres.resize(width * height, 0);
        Ok(())
    }

    /// Reads a raw image, in either byte order, with any distance from row to row.
    pub(crate) fn read(&mut self, image: &Image) -> Result<(), String> {
        let pixel_bytes = match image.encoding.as_str() {
            "16UC1" | "mono16" => 2,
            "32FC1" => 4,
            other => return Err(format!("encoding {other}")),
        };
        let (width, height, step) = (image.width as usize, image.height as usize, image.step as usize);
        let row_bytes = width.saturating_mul(pixel_bytes);
        let needed = step.saturating_mul(height.saturating_sub(1)).saturating_add(row_bytes);
        if step < row_bytes || image.data.len() < needed {
            let bytes = image.data.len();
            return Err(format!("{width} x {height} {} in rows of {step}, {bytes} bytes", image.encoding));
        }
        self.resize(width, height)?;
        let big = image.is_bigendian != 0;
        let rows = image.data.chunks(step).zip(self.millimetres.chunks_exact_mut(width));
        for (bytes, row) in rows {
            let bytes = &bytes[..row_bytes];
            if pixel_bytes == 2 {
                for (pixel, pair) in row.iter_mut().zip(bytes.chunks_exact(2)) {
                    let pair = [pair[0], pair[1]];
                    *pixel = if big { u16::from_be_bytes(pair) } else { u16::from_le_bytes(pair) };
                }
            } else {
                for (pixel, four) in row.iter_mut().zip(bytes.chunks_exact(4)) {
                    let four = [four[0], four[1], four[2], four[3]];
                    *pixel =
                        millimetres(if big { f32::from_be_bytes(four) } else { f32::from_le_bytes(four) });
                }
            }
        }
        Ok(())
    }

    /// Reads an image of the transport `compressedDepth`: 16 bits as PNG or RVL, or quantised inverse depth.
    pub(crate) fn read_compressed(&mut self, image: &CompressedImage) -> Result<(), String> {
        let format = image.format.as_str();
        let (encoding, transport) = format.split_once(';').unwrap_or((format, "compressedDepth"));
        let encoding = encoding.trim();
        let transport = transport.trim();
        if !is_depth(encoding)
            || !transport.starts_with("compressedDepth")
            || image.data.len() < CONFIGURATION
        {
            return Err(format!("format {format:?} in {} bytes", image.data.len()));
        }
        let (configuration, body) = image.data.split_at(CONFIGURATION);
        match transport.trim_start_matches("compressedDepth").trim() {
            "" | "png" => self.read_png(body)?,
            "rvl" => {
                let (width, height, body) = rvl::size(body).ok_or("an RVL image that ends at once")?;
                self.resize(width, height)?;
                rvl::decode(body, &mut self.millimetres).ok_or("a broken RVL image")?;
            }
            other => return Err(format!("compression {other}")),
        }
        if encoding == "32FC1" {
            let number = |at: usize| f32::from_le_bytes([0, 1, 2, 3].map(|i| configuration[at + i]));
            let (a, b) = (number(4), number(8));
            for pixel in self.millimetres.iter_mut().filter(|pixel| **pixel != 0) {
                *pixel = millimetres(a / (f32::from(*pixel) - b));
            }
        }
        Ok(())
    }

    fn read_png(&mut self, body: &[u8]) -> Result<(), String> {
        let broken = |error: png::DecodingError| format!("a PNG that is {error}");
        let mut reader = png::Decoder::new(std::io::Cursor::new(body)).read_info().map_err(broken)?;
        let info = reader.info();
        if info.color_type != png::ColorType::Grayscale || info.bit_depth != png::BitDepth::Sixteen {
            return Err(format!("a PNG of {:?} {:?}", info.color_type, info.bit_depth));
        }
        if info.interlaced {
            return Err("an interlaced PNG".into());
        }
        self.resize(info.width as usize, info.height as usize)?;
        for row in self.millimetres.chunks_exact_mut(self.width) {
            let bytes = reader.next_row().map_err(broken)?;
            let bytes = bytes.as_ref().map(|row| row.data()).unwrap_or_default();
            for (pixel, pair) in row.iter_mut().zip(bytes.chunks_exact(2)) {
                *pixel = u16::from_be_bytes([pair[0], pair[1]]);
            }
        }
        Ok(())
    }

    /// Every how many columns and rows a pixel is taken so that the image fits a depth frame.
    pub(crate) fn stride(&self) -> usize {
        self.width.div_ceil(ROOM.0).max(self.height.div_ceil(ROOM.1)).max(1)
    }

    /// Fills size and pixels of a frame: of each block of pixels the valid one nearest to its middle.
    pub(crate) fn fill(&self, frame: &mut DepthFrame) {
        let stride = self.stride();
        let (width, height) = (self.width / stride, self.height / stride);
        (frame.width, frame.height) = (width as u32, height as u32);
        frame.metres_per_unit = METRES_PER_UNIT;
        let (used, rest) = frame.pixels.split_at_mut(width * height);
        rest.fill(0);
        if stride == 1 {
            used.copy_from_slice(&self.millimetres);
            return;
        }
        let order = middle_first(stride);
        for (row, pixels) in used.chunks_exact_mut(width).enumerate() {
            for (col, pixel) in pixels.iter_mut().enumerate() {
                let corner = row * stride * self.width + col * stride;
                let block =
                    order.iter().map(|(down, right)| self.millimetres[corner + down * self.width + right]);
                *pixel = block.into_iter().find(|&value| value != 0).unwrap_or(0);
            }
        }
    }
}

/// Rows and columns of a block, those nearest to its middle first.
fn middle_first(side: usize) -> Vec<(usize, usize)> {
    let mut places: Vec<(usize, usize)> = (0..side * side).map(|at| (at / side, at % side)).collect();
    let off = |at: usize| (2 * at + 1).abs_diff(side);
    places.sort_by_key(|&(down, right)| off(down).pow(2) + off(right).pow(2));
    places
}

//! Pictures of pixels within a report: PNG as data URI.

use crate::canvas::{Canvas, Figure};
use crate::page::ReportError;
use std::fmt::Write as _;

/// A picture as PNG in a `data:` address.
///
/// # Errors
/// [`ReportError::Pixels`] where `rgba` is not 4 bytes for each of `width` x `height` pixels.
pub fn data_uri(width: u32, height: u32, rgba: &[u8]) -> Result<String, ReportError> {
    let needed = 4 * width as usize * height as usize;
    let unfit = |detail: String| ReportError::Pixels { width, height, found: rgba.len(), detail };
    if rgba.len() != needed {
        return Err(unfit(format!("needed {needed} bytes")));
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_compression(png::Compression::High);
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(rgba));
    written.map_err(|error| unfit(error.to_string()))?;
    Ok(format!("data:image/png;base64,{}", base64(&bytes)))
}

fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let word =
            three.iter().enumerate().fold(0_u32, |word, (i, byte)| word | u32::from(*byte) << (16 - 8 * i));
        for place in 0..4 {
            let letter = LETTERS[(word >> (18 - 6 * place)) as usize & 63];
            text.push(if place <= three.len() { letter as char } else { '=' });
        }
    }
    text
}

/// A picture of pixels with a title above it.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// What it shows.
    pub title: String,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Red, green, blue and opacity of each pixel, row by row from the top.
    pub rgba: Vec<u8>,
    /// Width in the figure; the height follows.
    pub shown_width: f64,
}

impl Picture {
    /// Draws the picture.
    ///
    /// # Errors
    /// As [`data_uri`].
    pub fn figure(&self) -> Result<Figure, ReportError> {
        let uri = data_uri(self.width, self.height, &self.rgba)?;
        let tall = self.shown_width * f64::from(self.height) / f64::from(self.width.max(1));
        let mut canvas = Canvas::default();
        canvas.text(0.0, 20.0, "strong", &self.title);
        canvas.raw(&image(&uri, 0.0, 30.0, self.shown_width, tall));
        Ok(canvas.figure(&self.title, self.shown_width, tall + 30.0))
    }
}

/// The element that shows a data URI.
pub(crate) fn image(uri: &str, left: f64, top: f64, width: f64, height: f64) -> String {
    let mut text = String::new();
    let _ = writeln!(
        text,
        "<image x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" \
         preserveAspectRatio=\"none\" style=\"image-rendering:pixelated\" href=\"{uri}\"/>"
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_the_standard() {
        // RFC 4648, section 10.
        let known = [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")];
        for (bytes, text) in known {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
    }

    #[test]
    fn a_wrong_number_of_pixels_is_refused_with_both_numbers() {
        let error = data_uri(2, 2, &[0; 15]).unwrap_err().to_string();
        assert!(error.contains("15") && error.contains("16"), "{error}");
    }
}

//! ROS map: a yaml file and a PGM picture; occupied cells become walls of 1 m.

use crate::solid::Solid;
use crate::world::{World, WorldError, read_text, unreadable};
use sidestep_msgs::Pose2;
use std::path::Path as FilePath;

/// `[m]` height of what a planar map calls occupied.
const WALL_TOP_M: f64 = 1.0;

/// What the yaml file says.
struct Header {
    image: String,
    resolution_m: f64,
    origin: [f64; 3],
    negate: bool,
    occupied: f64,
    raw: bool,
}

struct Picture {
    width: usize,
    height: usize,
    most: f64,
    pixels: Vec<u16>,
}

impl World {
    /// A ROS map; the robot starts at the map's origin of coordinates, without a path.
    ///
    /// # Errors
    /// [`WorldError`] naming file, what was found and what is needed.
    pub fn from_ros_map(yaml: &FilePath) -> Result<Self, WorldError> {
        let header = parse_header(&yaml.display().to_string(), &read_text(yaml)?)?;
        let image = yaml.parent().unwrap_or(FilePath::new(".")).join(&header.image);
        let bytes = std::fs::read(&image).map_err(|error| unreadable(&image, &error))?;
        let picture = parse_pgm(&image.display().to_string(), &bytes)?;
        let mut world = Self::empty();
        world.solids = walls(&header, &picture);
        Ok(world)
    }
}

fn parse_header(path: &str, text: &str) -> Result<Header, WorldError> {
    let bad = |detail: String| WorldError::Content { path: path.into(), detail };
    let value = |key: &str| {
        text.lines().enumerate().find_map(|(number, line)| {
            let (name, value) = line.split('#').next()?.split_once(':')?;
            (name.trim() == key).then(|| (number + 1, value.trim().trim_matches(['"', '\'']).to_owned()))
        })
    };
    let needed = |key: &str, kind: &str| {
        value(key).ok_or_else(|| bad(format!("key {key} is missing, needed: {kind}")))
    };
    let number = |key: &str, kind: &str| {
        let (line, found) = needed(key, kind)?;
        let parsed = found.parse::<f64>().ok().filter(|x| x.is_finite());
        parsed.ok_or_else(|| bad(format!("line {line}: {key} is \"{found}\", needed: {kind}")))
    };
    let resolution_m = number("resolution", "metres per pixel, 0.001 to 1")?;
    if !(0.001..=1.0).contains(&resolution_m) {
        return Err(bad(format!("resolution is {resolution_m}, needed: metres per pixel, 0.001 to 1")));
    }
    let (line, found) = needed("origin", "[x, y, yaw]")?;
    let numbers: Vec<f64> =
        found.trim_matches(['[', ']']).split(',').filter_map(|part| part.trim().parse().ok()).collect();
    let origin: [f64; 3] = numbers
        .try_into()
        .map_err(|_| bad(format!("line {line}: origin is \"{found}\", needed: [x, y, yaw]")))?;
    Ok(Header {
        image: needed("image", "the name of a PGM file")?.1,
        resolution_m,
        origin,
        negate: value("negate").is_some_and(|(_, text)| text == "1" || text == "true"),
        occupied: number("occupied_thresh", "a number from 0 to 1")?,
        raw: value("mode").is_some_and(|(_, text)| text == "raw"),
    })
}

/// Reads the next number of a PGM header, past blanks and comments.
fn next_number(bytes: &[u8], at: &mut usize) -> Option<usize> {
    while let Some(byte) = bytes.get(*at) {
        match byte {
            b'#' => *at += bytes[*at..].iter().position(|b| *b == b'\n')?,
            b if b.is_ascii_whitespace() => *at += 1,
            _ => break,
        }
    }
    let digits = bytes.get(*at..)?.iter().take_while(|b| b.is_ascii_digit()).count();
    let text = std::str::from_utf8(&bytes[*at..*at + digits]).ok()?;
    *at += digits;
    text.parse().ok()
}

fn parse_pgm(path: &str, bytes: &[u8]) -> Result<Picture, WorldError> {
    let bad = |detail: String| WorldError::Content { path: path.into(), detail };
    let binary = match bytes.get(..2) {
        Some(b"P5") => true,
        Some(b"P2") => false,
        other => {
            let found = String::from_utf8_lossy(other.unwrap_or(&[])).into_owned();
            return Err(bad(format!("begins with \"{found}\", needed: a PGM picture (P5 or P2)")));
        }
    };
    let mut at = 2;
    let mut number =
        |what: &str| next_number(bytes, &mut at).ok_or_else(|| bad(format!("PGM header without {what}")));
    let (width, height, most) = (number("width")?, number("height")?, number("largest grey")?);
    if width == 0 || height == 0 || width > 20_000 || height > 20_000 || !(1..=65_535).contains(&most) {
        return Err(bad(format!("{width} x {height} of {most} greys, needed: 1 to 20000 and 1 to 65535")));
    }
    let count = width * height;
    let pixels: Vec<u16> = if binary {
        let data = bytes.get(at + 1..).unwrap_or(&[]);
        if most < 256 {
            data.iter().take(count).map(|b| u16::from(*b)).collect()
        } else {
            data.chunks_exact(2).take(count).map(|b| u16::from_be_bytes([b[0], b[1]])).collect()
        }
    } else {
        (0..count).map_while(|_| next_number(bytes, &mut at)).map(|grey| grey.min(65_535) as u16).collect()
    };
    if pixels.len() < count {
        return Err(bad(format!("{} pixels, needed: {width} x {height} = {count}", pixels.len())));
    }
    Ok(Picture { width, height, most: most as f64, pixels })
}

/// Occupied runs of a row, joined downwards where the next row has the same run.
fn walls(header: &Header, picture: &Picture) -> Vec<Solid> {
    let occupied = |pixel: u16| {
        let part = f64::from(pixel) / picture.most;
        if header.raw {
            return (65..=100).contains(&pixel);
        }
        (if header.negate { part } else { 1.0 - part }) > header.occupied
    };
    let frame = Pose2::new(header.origin[0], header.origin[1], header.origin[2]);
    let mut solids = Vec::new();
    // (first column, columns, first row from the top) of blocks that may still grow.
    let mut open: Vec<(usize, usize, usize)> = Vec::new();
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for row in 0..=picture.height {
        runs.clear();
        if row < picture.height {
            let pixels = &picture.pixels[row * picture.width..(row + 1) * picture.width];
            let mut col = 0;
            while col < pixels.len() {
                let length = pixels[col..].iter().take_while(|pixel| occupied(**pixel)).count();
                if length > 0 {
                    runs.push((col, length));
                }
                col += length + 1;
            }
        }
        open.retain(|block| {
            if let Some(same) = runs.iter().position(|run| (run.0, run.1) == (block.0, block.1)) {
                runs.swap_remove(same);
                return true;
            }
            solids.push(block_of(*block, row, header, picture, &frame));
            false
        });
        runs.sort_unstable();
        open.extend(runs.iter().map(|run| (run.0, run.1, row)));
    }
    solids
}

fn block_of(
    block: (usize, usize, usize),
    end_row: usize,
    header: &Header,
    picture: &Picture,
    frame: &Pose2,
) -> Solid {
    let (col, cols, first_row) = block;
    let rows = end_row - first_row;
    let m = header.resolution_m;
    // Row 0 is the top of the picture, the farthest along y.
    let x = (col as f64 + 0.5 * cols as f64) * m;
    let y = ((picture.height - end_row) as f64 + 0.5 * rows as f64) * m;
    let (x, y) = frame.transform(x, y);
    Solid::block([x, y], [cols as f64 * m, rows as f64 * m], frame.yaw_rad, [0.0, WALL_TOP_M])
}

#[cfg(test)]
mod tests {
    use super::*;

    const YAML: &str = "image: m.pgm\nresolution: 0.5\norigin: [-1.0, -2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n";

    #[test]
    fn occupied_cells_become_walls_where_the_yaml_places_them() {
        let header = parse_header("m.yaml", YAML).unwrap();
        // 3 x 2, the two left cells of the top row and the left one of the bottom row occupied, 205 = unknown.
        let plain = parse_pgm("m.pgm", b"P2 # text\n3 2\n255\n0 0 254\n0 205 254\n").unwrap();
        let binary =
            parse_pgm("m.pgm", &[b"P5\n3 2\n255\n".as_slice(), &[0, 0, 254, 0, 205, 254]].concat()).unwrap();
        for picture in [plain, binary] {
            let world = World { solids: walls(&header, &picture), ..World::empty() };
            // Top row: y in [-1.5, -1.0], x in [-1, 0]; bottom row: y in [-2, -1.5], x in [-1, -0.5].
            for (point, inside) in [
                ([-0.25, -1.25], true),
                ([-0.75, -1.75], true),
                ([-0.25, -1.75], false),
                ([0.25, -1.25], false),
            ] {
                assert_eq!(world.clearance_m(point, 1.0) < 1e-9, inside, "{point:?} {:?}", world.solids);
            }
        }
    }

    #[test]
    fn equal_rows_make_one_wall() {
        let header = parse_header("m.yaml", YAML).unwrap();
        let picture = parse_pgm("m.pgm", b"P2 3 3 255 0 254 0 0 254 0 0 254 0").unwrap();
        assert_eq!(walls(&header, &picture).len(), 2);
    }

    #[test]
    fn bad_maps_say_what_was_found_and_what_is_needed() {
        let message = |text: &str| parse_header("m.yaml", text).err().unwrap().to_string();
        assert!(message(&YAML.replace("0.5", "wide")).contains("line 2: resolution is \"wide\""));
        assert!(message(&YAML.replace("origin", "origen")).contains("key origin is missing"));
        assert!(message(&YAML.replace("[-1.0, -2.0, 0.0]", "[1]")).contains("needed: [x, y, yaw]"));
        let picture = |bytes: &[u8]| parse_pgm("m.pgm", bytes).err().unwrap().to_string();
        assert!(picture(b"P6 1 1 255").contains("needed: a PGM picture"));
        assert!(picture(b"P5 4 4 255 abc").contains("needed: 4 x 4 = 16"));
        assert!(picture(b"").contains("needed: a PGM picture"));
    }

    #[test]
    fn the_maps_of_the_data_folder_load() {
        let Some(data) = crate::fixtures::data_folder("the_maps_of_the_data_folder_load") else { return };
        for (name, least) in [("mrpb/maps/office02", 50), ("mrpb/maps/maze", 50), ("nav2", 50)] {
            let file = if name == "nav2" { "tb3_sandbox.yaml" } else { "map.yaml" };
            let path = data.join("maps").join(name).join(file);
            let world = World::named(&path.display().to_string(), 0).unwrap();
            assert!(world.solids.len() >= least, "{name}: {}", world.solids.len());
        }
    }
}

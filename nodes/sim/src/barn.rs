//! BARN: 300 cylinder fields for a Jackal (Perille et al. 2020), from the xz archive or one unpacked SDF file.
//!
//! The task is that of the BARN challenge: start (-2.25, 3) facing +y, goal 10 m ahead, along the reference path.

use crate::solid::Solid;
use crate::world::{World, WorldError, unreadable};
use sidestep_msgs::Pose2;
use std::io::Read;
use std::path::Path as FilePath;

/// `[m]` radius of every cylinder.
const RADIUS_M: f64 = 0.075;
/// `[m]` height of every cylinder.
const TOP_M: f64 = 1.0;
/// `[m]` start of the task.
const START_M: [f64; 2] = [-2.25, 3.0];
/// `[m]` goal of the task.
const GOAL_M: [f64; 2] = [-2.25, 13.0];

impl World {
    /// World `number` of an archive of SDF files, with the reference path `path_files/path_N.npy` beside it.
    ///
    /// # Errors
    /// [`WorldError`] where archive, member or path file is missing or not of its format.
    pub fn barn(archive: &FilePath, number: u32) -> Result<Self, WorldError> {
        let mut found = barn_worlds(archive, |candidate| candidate == number)?;
        found.pop().map(|(_, world)| world).ok_or_else(|| WorldError::Content {
            path: archive.display().to_string(),
            detail: format!("has no world_{number}.world; list its members with tar -tJf"),
        })
    }

    /// One SDF file: every model `unit_cylinder` is a column.
    ///
    /// # Errors
    /// [`WorldError::Content`] where no cylinder is found.
    pub fn from_sdf(path: &str, text: &str) -> Result<Self, WorldError> {
        let mut world = Self::empty();
        world.solids = cylinders(text);
        if world.solids.is_empty() {
            let detail = "no model 'unit_cylinder' with a pose, needed: a BARN world".into();
            return Err(WorldError::Content { path: path.into(), detail });
        }
        world.start = Pose2::new(START_M[0], START_M[1], std::f64::consts::FRAC_PI_2);
        world.legs_m = vec![vec![START_M, GOAL_M]];
        Ok(world)
    }
}

/// All worlds of an archive whose number `wanted` accepts, in the archive's order; unpacked once.
///
/// # Errors
/// [`WorldError`] where archive or path file is missing or not of its format.
pub fn barn_worlds(
    archive: &FilePath,
    mut wanted: impl FnMut(u32) -> bool,
) -> Result<Vec<(u32, World)>, WorldError> {
    let name = archive.display().to_string();
    let bad = |detail: String| WorldError::Content { path: name.clone(), detail };
    let file = std::fs::File::open(archive).map_err(|error| unreadable(archive, &error))?;
    let mut tar = lzma_rust2::XzReader::new(std::io::BufReader::new(file), false);
    let folder = archive.parent().unwrap_or(FilePath::new(".")).join("path_files");
    let mut worlds = Vec::new();
    let mut header = [0_u8; 512];
    loop {
        let read = tar.read_exact(&mut header);
        read.map_err(|error| bad(format!("is no whole xz archive ({error})")))?;
        let Some((member, size)) = tar_member(&header) else { break };
        let mut data = (&mut tar).take(size.next_multiple_of(512));
        let number = member.strip_prefix("world_").and_then(|rest| rest.strip_suffix(".world"));
        if let Some(number) = number.and_then(|text| text.parse().ok()).filter(|number| wanted(*number)) {
            let mut text = String::new();
            data.read_to_string(&mut text).map_err(|error| bad(format!("member {member}: {error}")))?;
            let mut world = World::from_sdf(&format!("{name}#{number}"), &text)?;
            world.legs_m = vec![task_path(&folder.join(format!("path_{number}.npy")))?];
            worlds.push((number, world));
        } else {
            let skipped = std::io::copy(&mut data, &mut std::io::sink());
            skipped.map_err(|error| bad(format!("member {member}: {error}")))?;
        }
    }
    Ok(worlds)
}

/// The numbers of every `stride`th world of a BARN folder, by the sorted list of the names of its path files.
///
/// # Errors
/// [`WorldError::Read`] where the folder is missing.
pub fn barn_selection(folder: &FilePath, stride: usize) -> Result<Vec<u32>, WorldError> {
    let paths = folder.join("path_files");
    let files = std::fs::read_dir(&paths).map_err(|error| unreadable(&paths, &error))?;
    let mut names: Vec<String> = files.filter_map(|file| file.ok()?.file_name().into_string().ok()).collect();
    names.sort_unstable();
    let number = |name: &String| name.strip_prefix("path_")?.strip_suffix(".npy")?.parse().ok();
    Ok(names.iter().filter_map(number).step_by(stride.max(1)).collect())
}

/// Name (without folders) and size of a tar member; `None` at the end of the archive.
fn tar_member(header: &[u8; 512]) -> Option<(String, u64)> {
    let text = |range: std::ops::Range<usize>| {
        let bytes = &header[range];
        let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
        String::from_utf8_lossy(&bytes[..end]).trim().to_owned()
    };
    let name = text(0..100);
    if name.is_empty() {
        return None;
    }
    let size = u64::from_str_radix(&text(124..136), 8).ok()?;
    Some((name.rsplit('/').next().unwrap_or("").to_owned(), size))
}

/// The first pose of each cylinder's model; the file repeats them as state.
fn cylinders(text: &str) -> Vec<Solid> {
    let models = text.split("<state").next().unwrap_or("");
    let poses = models.split("<model name='unit_cylinder").skip(1).filter_map(|model| {
        let pose = model.split_once("<pose")?.1.split_once('>')?.1.split('<').next()?;
        let mut numbers = pose.split_whitespace().map_while(|part| part.parse::<f64>().ok());
        Some([numbers.next()?, numbers.next()?])
    });
    poses.map(|centre| Solid::column(centre, RADIUS_M, [0.0, TOP_M])).collect()
}

/// Start, the reference path, goal.
fn task_path(path: &FilePath) -> Result<Vec<[f64; 2]>, WorldError> {
    let bytes = std::fs::read(path).map_err(|error| unreadable(path, &error))?;
    let cells = npy_pairs(&bytes).ok_or_else(|| WorldError::Content {
        path: path.display().to_string(),
        detail: "is no numpy array of int64 (n, 2), needed: a BARN reference path".into(),
    })?;
    let along = cells.iter().map(|cell| [cell[0] as f64 * 0.15 - 4.575, cell[1] as f64 * 0.15 + 5.075]);
    Ok(std::iter::once(START_M).chain(along).chain(std::iter::once(GOAL_M)).collect())
}

/// Rows of a numpy file of little-endian int64 pairs.
fn npy_pairs(bytes: &[u8]) -> Option<Vec<[i64; 2]>> {
    let length = usize::from(u16::from_le_bytes([*bytes.get(8)?, *bytes.get(9)?]));
    let header = std::str::from_utf8(bytes.get(10..10 + length)?).ok()?;
    let known = bytes.starts_with(b"\x93NUMPY\x01")
        && header.contains("'<i8'")
        && header.contains("False")
        && header.contains(", 2)");
    let data = bytes.get(10 + length..)?;
    let number = |chunk: &[u8]| chunk.try_into().map(i64::from_le_bytes).unwrap_or(0);
    known.then(|| data.chunks_exact(16).map(|pair| [number(&pair[..8]), number(&pair[8..])]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_twelfth_world_of_the_sorted_list_loads_and_its_path_is_free() {
        let Some(data) = crate::fixtures::data_folder("every_twelfth_world_of_the_sorted_list_loads") else {
            return;
        };
        let numbers = crate::barn_selection(&data.join("barn"), 12).unwrap();
        assert_eq!(numbers.len(), 20);
        let worlds = barn_worlds(&data.join("barn/worlds.tar.xz"), |n| numbers.contains(&n)).unwrap();
        assert_eq!(worlds.len(), 20);
        for (number, world) in &worlds {
            assert!((150..400).contains(&world.solids.len()), "{number}: {}", world.solids.len());
            for point in crate::resample(&world.legs_m[0], 0.05) {
                let clearance = world.clearance_m(point, 1.0);
                assert!(clearance > 0.2, "world {number}: {clearance:.3} m at {point:?}");
            }
        }
    }

    #[test]
    fn an_archive_that_is_none_is_refused_with_its_path() {
        let file = std::env::temp_dir().join(format!("sidestep-no-archive-{}.tar.xz", std::process::id()));
        std::fs::write(&file, b"no archive").unwrap();
        let error = World::barn(&file, 1).unwrap_err().to_string();
        std::fs::remove_file(&file).unwrap();
        assert!(error.contains("sidestep-no-archive") && error.contains("no whole xz archive"), "{error}");
    }

    #[test]
    fn a_file_without_cylinders_says_what_is_needed() {
        let error = World::from_sdf("a.world", "<sdf/>").unwrap_err().to_string();
        assert!(error.contains("a.world") && error.contains("unit_cylinder"), "{error}");
    }
}

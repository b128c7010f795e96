//! A world: solids, people, a place to start and paths to follow; with the ways to get one.

use crate::people::Walker;
use crate::solid::Solid;
use sidestep_msgs::Pose2;
use std::path::Path as FilePath;

/// `[m]` distances beyond this are reported as this.
pub const CLEARANCE_MAX_M: f64 = 3.0;

/// Why a world was refused.
#[derive(Debug, thiserror::Error)]
pub enum WorldError {
    /// A file that is not there or cannot be read.
    #[error("world: {path} cannot be read ({detail}); {remedy}")]
    Read {
        /// The file.
        path: String,
        /// What the system says.
        detail: String,
        /// What to do.
        remedy: &'static str,
    },
    /// A file that does not hold what its kind needs.
    #[error("world: {path}: {detail}")]
    Content {
        /// The file.
        path: String,
        /// Where in it, what was found and what is needed.
        detail: String,
    },
    /// A name of no known kind.
    #[error(
        "world: \"{found}\" is of no known kind; needed: office, corridor, room, a .toml world file, a .yaml ROS map, \
         a .world file, or ARCHIVE.tar.xz#N for world N of a BARN archive"
    )]
    Kind {
        /// What was asked for.
        found: String,
    },
}

/// A static scene with people and tasks.
#[derive(Debug, Clone, PartialEq)]
pub struct World {
    /// What stands there.
    pub solids: Vec<Solid>,
    /// Who walks there; a simulation takes as many as its configuration says.
    pub walkers: Vec<Walker>,
    /// Where the robot starts.
    pub start: Pose2,
    /// `[m]` paths in the world, followed one after the other.
    pub legs_m: Vec<Vec<[f64; 2]>>,
    /// Whether the first path follows the last.
    pub endless: bool,
}

impl World {
    /// Nothing but the floor, a start at the origin and no path.
    #[must_use]
    pub fn empty() -> Self {
        Self {
            solids: Vec::new(),
            walkers: Vec::new(),
            start: Pose2::ORIGIN,
            legs_m: Vec::new(),
            endless: false,
        }
    }

    /// The world that a configuration names: a built-in one or a file.
    ///
    /// # Errors
    /// [`WorldError`] with what was found, what is needed, and the remedy.
    pub fn named(name: &str, seed: u64) -> Result<Self, WorldError> {
        match name {
            "office" => return Ok(Self::office(seed)),
            "corridor" => return Ok(Self::corridor(seed, 1.0)),
            "room" => return Ok(Self::room(seed, 1.0)),
            _ => {}
        }
        if let Some((archive, number)) = name.rsplit_once('#') {
            let number = number.parse().map_err(|_| WorldError::Kind { found: name.into() })?;
            return Self::barn(FilePath::new(archive), number);
        }
        let path = FilePath::new(name);
        match path.extension().and_then(|extension| extension.to_str()) {
            Some("toml") => Self::from_toml(name, &read_text(path)?),
            Some("yaml" | "yml") => Self::from_ros_map(path),
            Some("world") => Self::from_sdf(name, &read_text(path)?),
            _ => Err(WorldError::Kind { found: name.into() }),
        }
    }

    /// `[m]` distance of a point on the floor to the nearest solid that reaches below `top_m`, up to
    /// [`CLEARANCE_MAX_M`].
    #[must_use]
    pub fn clearance_m(&self, point_m: [f64; 2], top_m: f64) -> f64 {
        let near = self.solids.iter().filter(|solid| solid.is_in_band(top_m));
        near.fold(CLEARANCE_MAX_M, |least, solid| least.min(solid.distance_m(point_m)))
    }

    /// The same world seen in a mirror along x: what was left is right.
    #[must_use]
    pub fn mirrored(&self) -> Self {
        let mut world = self.clone();
        for solid in &mut world.solids {
            solid.y_m = -solid.y_m;
            if let crate::solid::Outline::Rectangle { sin, .. } = &mut solid.outline {
                *sin = -*sin;
            }
        }
        let flip = |points: &mut Vec<[f64; 2]>| points.iter_mut().for_each(|point| point[1] = -point[1]);
        world.walkers.iter_mut().for_each(|walker| flip(&mut walker.waypoints_m));
        world.legs_m.iter_mut().for_each(flip);
        world.start = Pose2::new(self.start.x_m, -self.start.y_m, -self.start.yaw_rad);
        world
    }
}

/// The text of a file.
pub(crate) fn read_text(path: &FilePath) -> Result<String, WorldError> {
    std::fs::read_to_string(path).map_err(|error| unreadable(path, &error))
}

/// The error for a file that cannot be read.
pub(crate) fn unreadable(path: &FilePath, error: &std::io::Error) -> WorldError {
    WorldError::Read {
        path: path.display().to_string(),
        detail: error.to_string(),
        remedy: "give the path of an existing file, or world = \"office\"",
    }
}

/// Points every `spacing_m` along a polyline, the last one included.
#[must_use]
pub fn resample(points_m: &[[f64; 2]], spacing_m: f64) -> Vec<[f64; 2]> {
    let mut out: Vec<[f64; 2]> = points_m.first().copied().into_iter().collect();
    let mut due_m = spacing_m;
    for pair in points_m.windows(2) {
        let (dx, dy) = (pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]);
        let length = libm::hypot(dx, dy);
        while due_m <= length {
            out.push([pair[0][0] + dx * due_m / length, pair[0][1] + dy * due_m / length]);
            due_m += spacing_m;
        }
        due_m -= length;
    }
    if let (Some(last), Some(end)) = (out.last(), points_m.last())
        && libm::hypot(end[0] - last[0], end[1] - last[1]) > 1e-6
    {
        out.push(*end);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_resampled_line_has_even_steps_and_keeps_its_end() {
        let points = resample(&[[0.0, 0.0], [0.25, 0.0], [0.25, 0.3]], 0.1);
        assert_eq!(points.len(), 7);
        assert!((points[3][0] - 0.25).abs() < 1e-9 && (points[3][1] - 0.05).abs() < 1e-9, "{points:?}");
        assert_eq!(points.last(), Some(&[0.25, 0.3]));
    }

    #[test]
    fn an_unknown_kind_says_what_is_needed() {
        let error = World::named("castle", 1).unwrap_err().to_string();
        assert!(error.contains("castle") && error.contains("office") && error.contains("ROS map"), "{error}");
    }

    #[test]
    fn a_missing_file_names_path_and_remedy() {
        for name in
            ["/nowhere/world.toml", "/nowhere/map.yaml", "/nowhere/worlds.tar.xz#3", "/nowhere/a.world"]
        {
            let error = World::named(name, 1).unwrap_err().to_string();
            let path = name.split('#').next().unwrap();
            assert!(error.contains(path) && error.contains("give the path"), "{error}");
        }
    }
}

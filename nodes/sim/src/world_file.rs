//! A world written by hand in TOML.

use crate::people::Walker;
use crate::solid::Solid;
use crate::world::{World, WorldError};
use serde::Deserialize;
use sidestep_msgs::Pose2;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    start: Start,
    #[serde(default)]
    endless: bool,
    #[serde(default)]
    wall: Vec<Wall>,
    #[serde(default, rename = "box")]
    block: Vec<Block>,
    #[serde(default)]
    cylinder: Vec<Cylinder>,
    #[serde(default)]
    table: Vec<Table>,
    #[serde(default)]
    person: Vec<Person>,
    #[serde(default)]
    path: Vec<Leg>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Start {
    x_m: f64,
    y_m: f64,
    yaw_rad: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Wall {
    from_m: [f64; 2],
    to_m: [f64; 2],
    thickness_m: f64,
    top_m: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Block {
    centre_m: [f64; 2],
    size_m: [f64; 2],
    yaw_rad: f64,
    bottom_m: f64,
    top_m: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Cylinder {
    centre_m: [f64; 2],
    radius_m: f64,
    bottom_m: f64,
    top_m: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    centre_m: [f64; 2],
    size_m: [f64; 2],
    yaw_rad: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Person {
    waypoints_m: Vec<[f64; 2]>,
    speed_m_s: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Leg {
    points_m: Vec<[f64; 2]>,
}

impl World {
    /// A world file; see the README for its keys.
    ///
    /// # Errors
    /// [`WorldError::Content`] with line and column of an unknown key or a wrong type, or the value out of range.
    pub fn from_toml(path: &str, text: &str) -> Result<Self, WorldError> {
        let bad = |detail: String| WorldError::Content { path: path.into(), detail };
        let file: File = toml::from_str(text).map_err(|error| bad(error.to_string()))?;
        let mut world = Self::empty();
        world.start = Pose2::new(file.start.x_m, file.start.y_m, file.start.yaw_rad);
        world.endless = file.endless;
        let walls = file.wall.iter().map(|w| Solid::wall(w.from_m, w.to_m, w.thickness_m, w.top_m));
        let blocks =
            file.block.iter().map(|b| Solid::block(b.centre_m, b.size_m, b.yaw_rad, [b.bottom_m, b.top_m]));
        let columns =
            file.cylinder.iter().map(|c| Solid::column(c.centre_m, c.radius_m, [c.bottom_m, c.top_m]));
        let tables = file.table.iter().flat_map(|t| crate::office::table(t.centre_m, t.size_m, t.yaw_rad));
        world.solids = walls.chain(blocks).chain(columns).chain(tables).collect();
        for (index, solid) in world.solids.iter().enumerate() {
            let numbers = [solid.x_m, solid.y_m, solid.bottom_m, solid.top_m, solid.reach_m()];
            if !numbers.iter().all(|x| x.is_finite())
                || solid.top_m <= solid.bottom_m
                || solid.reach_m() <= 0.0
            {
                return Err(bad(format!(
                    "solid {index} (walls, boxes, cylinders, tables in this order) is {solid:?}, needed: finite, \
                     larger than nothing, top_m above bottom_m"
                )));
            }
        }
        world.walkers = file
            .person
            .into_iter()
            .map(|person| Walker { waypoints_m: person.waypoints_m, speed_m_s: person.speed_m_s })
            .collect();
        world.legs_m = file.path.into_iter().map(|leg| leg.points_m).collect();
        if world.legs_m.iter().any(|leg| leg.len() < 2) {
            return Err(bad("a path has less than 2 points, needed: at least 2".into()));
        }
        Ok(world)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "
start = { x_m = 1.0, y_m = 2.0, yaw_rad = 0.0 }

[[wall]]
from_m = [3.0, 0.0]
to_m = [3.0, 4.0]
thickness_m = 0.2
top_m = 2.0

[[person]]
waypoints_m = [[0.0, 0.0], [1.0, 0.0]]
speed_m_s = 0.5

[[path]]
points_m = [[1.0, 2.0], [2.0, 2.0]]
";

    #[test]
    fn a_world_file_says_where_everything_is() {
        let world = World::from_toml("w.toml", TEXT).unwrap();
        assert!((world.clearance_m([1.0, 2.0], 1.0) - 1.9).abs() < 1e-9);
        assert_eq!((world.walkers.len(), world.legs_m.len()), (1, 1));
    }

    #[test]
    fn an_unknown_key_is_named_with_line_and_what_is_allowed() {
        let error =
            World::from_toml("w.toml", &TEXT.replace("thickness_m", "thick")).unwrap_err().to_string();
        assert!(
            error.contains("w.toml") && error.contains("line 7") && error.contains("thickness_m"),
            "{error}"
        );
        let error = World::from_toml("w.toml", &TEXT.replace("0.2", "\"wide\"")).unwrap_err().to_string();
        assert!(error.contains("line 7") && error.contains("column"), "{error}");
    }

    #[test]
    fn a_solid_of_no_size_is_refused() {
        let error =
            World::from_toml("w.toml", &TEXT.replace("top_m = 2.0", "top_m = -1.0")).unwrap_err().to_string();
        assert!(error.contains("top_m above bottom_m"), "{error}");
    }
}

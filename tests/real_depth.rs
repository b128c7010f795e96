//! Real depth through the mapper: a HoloLens walk against an independent fusion, a robot's images against hand labels.

mod batch;
mod labels;
mod picture;

use batch::{Batch, Seen};
use labels::Thing;
use sidestep_import::{Intrinsics, Options, Placing, Source, Up};
use sidestep_mapper::{CLEAR_BELOW, Config, Mapper};
use sidestep_msgs::{AGE_NEVER, DepthFrame, Odometry, Robot, SAFETY_GRID, SAFETY_SIDE, SafetyMap, Status};
use std::path::{Path, PathBuf};

/// Above this a cell counts as occupied; unknown is just this.
const OCCUPIED: u8 = 128;
/// Images before an evaluation begins: the walk needs some to see anything twice.
const WARM_UP: usize = 20;

/// The root of the repository, whichever crate this file is built in.
pub(crate) fn root() -> &'static Path {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.ancestors().find(|folder| folder.join("launch/robots").is_dir()).unwrap()
}

/// The data folder, or `None` with a line that says what is skipped.
fn data(what: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("SIDESTEP_DATA");
    if folder.is_none() {
        println!("skipped: SIDESTEP_DATA is not set ({what})");
    }
    folder.map(PathBuf::from)
}

fn robot() -> Robot {
    let path = root().join("launch/robots/loomo.toml");
    Robot::from_toml("loomo.toml", &std::fs::read_to_string(path).unwrap()).unwrap()
}

/// The mapper as shipped, but for the disc that an operator grants at the start: nobody looked at it here.
fn mapper() -> Mapper {
    Mapper::new(&Config { grant_start_disc: false, ..Config::shipped() }, &robot()).unwrap()
}

/// A mapper that is given a folder image by image, with all odometry up to shortly after each.
struct Walk {
    source: Source,
    odometry: std::vec::IntoIter<Odometry>,
    frame: Box<DepthFrame>,
    mapper: Mapper,
    map: Box<SafetyMap>,
}

impl Walk {
    fn new(options: &Options) -> Self {
        let source = Source::open(options).unwrap();
        let odometry = source.odometry().into_iter();
        let frame = bytemuck::allocation::zeroed_box();
        Self { source, odometry, frame, mapper: mapper(), map: bytemuck::allocation::zeroed_box() }
    }

    /// Maps one image; the safety map after it is in `map`, the image in `frame`.
    fn step(&mut self, image: usize) {
        assert!(self.source.depth(image, &mut self.frame).unwrap());
        let until_ns = self.frame.capture_ns + 20_000_000;
        while self.odometry.as_slice().first().is_some_and(|odometry| odometry.stamp_ns <= until_ns) {
            self.mapper.odometry(&self.odometry.next().unwrap());
        }
        let status = self.mapper.depth(&self.frame);
        assert_eq!(status, Status::Ok, "image {image}");
        self.mapper.write_safety(&mut self.map);
    }
}

fn hololens(folder: PathBuf) -> Options {
    Options {
        folder,
        metres_per_unit: 0.001,
        rate_hz: 10.0,
        intrinsics: None,
        placing: Placing::Poses { up: Up::Y, floor_m: Some(-1.53) },
    }
}

/// What an evaluation counted, over all images.
#[derive(Debug, Default)]
struct Score {
    /// Occupied in the batch.
    occupied: u64,
    /// Of these, occupied in the map within one cell.
    found: u64,
    /// Of these, free in the map at the very cell.
    hidden: u64,
    /// Free in the batch.
    free: u64,
    /// Of these, free in the map.
    known_free: u64,
    /// Free in the map and judged in the batch, either way.
    claimed: u64,
}

impl Score {
    /// Of what is there, the part that the map shows within one cell.
    fn recall(&self) -> f64 {
        self.found as f64 / self.occupied as f64
    }

    /// Of what the map calls free, the part where something is.
    fn false_free(&self) -> f64 {
        self.hidden as f64 / self.claimed as f64
    }

    /// Compares the map with the batch, cell by cell of the batch, within the map.
    fn compare(&mut self, map: &SafetyMap, batch: &Batch) {
        for (seen, x_m, y_m) in batch.cells() {
            let (x, y) = map.frame().inverse_transform(x_m, y_m);
            // Well within the map, so that all neighbours are, too.
            if x.abs().max(y.abs()) > 1.9 {
                continue;
            }
            let (row, col) = SAFETY_GRID.row_col(x as f32, y as f32).unwrap();
            let at = row * SAFETY_SIDE + col;
            let is_free = map.age[at] != AGE_NEVER && map.occupancy[at] < CLEAR_BELOW;
            match seen {
                Seen::Occupied => {
                    let mut near = (row - 1..=row + 1)
                        .flat_map(|row| (col - 1..=col + 1).map(move |col| row * SAFETY_SIDE + col));
                    self.occupied += 1;
                    self.found += u64::from(near.any(|at| map.occupancy[at] > OCCUPIED));
                    self.hidden += u64::from(is_free);
                    self.claimed += u64::from(is_free);
                }
                Seen::Free => {
                    self.free += 1;
                    self.known_free += u64::from(is_free);
                    self.claimed += u64::from(is_free);
                }
                Seen::Unsure => {}
            }
        }
    }
}

/// Maps a walk image by image and compares each map with the batch of the images so far.
fn walk(options: &Options, pictures: &[usize]) -> Score {
    let mut walk = Walk::new(options);
    let mut batch = Batch::new();
    let mut score = Score::default();
    for image in 0..walk.source.len() {
        walk.step(image);
        batch.add(&walk.frame, &walk.source.base(image));
        if image >= WARM_UP {
            score.compare(&walk.map, &batch);
        }
        if pictures.contains(&image) {
            picture::safety(&format!("walk-{image}"), &walk.map, Some(&batch));
        }
    }
    println!(
        "{} images: occupied {} found {:.2} % free at the cell {:.3} %; of the free cells claimed {:.3} % occupied; \
         of the batch's free cells {:.1} % known free",
        walk.source.len(),
        score.occupied,
        100.0 * score.recall(),
        100.0 * score.hidden as f64 / score.occupied as f64,
        100.0 * score.false_free(),
        100.0 * score.known_free as f64 / score.free as f64
    );
    score
}

/// The whole walk of the data folder: what several images show clearly is in the map, and what it calls free is free.
#[test]
fn a_walk_past_furniture_is_mapped_as_all_its_points_together_say() {
    let Some(data) = data("whole HoloLens walk") else { return };
    let score = walk(&hololens(data.join("depth_hololens")), &[40, 80, 120, 160, 200, 240]);
    assert!(score.occupied > 10_000 && score.free > 10_000, "{score:?}");
    assert!(score.recall() >= 0.95, "{score:?}");
    assert!(score.false_free() <= 0.005, "{score:?}");
    // A map of walls only would pass all of the above.
    assert!(score.known_free as f64 >= 0.8 * score.free as f64, "{score:?}");
}

/// The same on the excerpt that lies in the repository, so that any machine has seen real depth.
#[test]
fn the_excerpt_in_the_repository_is_mapped_as_well() {
    let score = walk(&hololens(root().join("tests/data/hololens")), &[]);
    assert!(score.occupied > 1000 && score.free > 1000, "{score:?}");
    assert!(score.recall() >= 0.95 && score.false_free() <= 0.005, "{score:?}");
}

/// A robot's own images, each mapped alone: the floor is free, what stands on it is occupied, as a person sees it.
#[test]
fn floor_is_free_and_table_feet_backpack_and_wall_are_occupied_as_labelled_by_hand() {
    let Some(data) = data("images of the AIMS robot") else { return };
    let mut walk = Walk::new(&Options {
        folder: data.join("depth_aims"),
        metres_per_unit: 0.001,
        rate_hz: 10.0,
        intrinsics: Some(Intrinsics { fx_px: 384.0, fy_px: 384.0, cx_px: 320.0, cy_px: 240.0 }),
        placing: Placing::FloorFit { seed: 1 },
    });
    let labels = labels::read(&root().join("tests/data/aims_labels.toml"));
    let (mut wrong, mut floor) = (Vec::new(), [0; 2]);
    for image in 0..walk.source.len() {
        walk.step(image);
        for label in labels.iter().filter(|label| label.image == image) {
            let verdict = label.ask(&walk.frame, &walk.map);
            println!("image {image} {}: {verdict:?}", label.name);
            let needed = match label.is {
                Thing::Obstacle => {
                    verdict.near_occupied as f64 >= 0.95 * f64::from(verdict.cells) && verdict.free == 0
                }
                Thing::Floor => {
                    floor = [floor[0] + verdict.cells, floor[1] + verdict.free];
                    // One image alone leaves cells unknown far away; none may be called occupied.
                    4 * verdict.free >= 3 * verdict.cells && verdict.occupied == 0
                }
            };
            if verdict.cells == 0 || !needed {
                wrong.push(format!("image {image}, {} ({:?}): {verdict:?}", label.name, label.is));
            }
        }
        if labels.iter().any(|label| label.image == image) {
            picture::safety(&format!("aims-{image}"), &walk.map, None);
            picture::depth(&format!("aims-{image}-depth"), &walk.frame);
        }
    }
    println!("floor: {} of {} cells free", floor[1], floor[0]);
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(100 * floor[1] >= 95 * floor[0], "{floor:?}");
}

//! Which topics of a bag are imported: those that were named, else those that can be told by their type.

use crate::error::BagError;
use crate::options::BagOptions;
use crate::raster;
use crate::survey::{Kind, Seen, Survey};
use crate::tree::Route;
use sidestep_import::Intrinsics;

/// The frame that robots of ROS have on the floor below `base_link`.
const FOOTPRINT: &str = "base_footprint";

/// Where the poses of base come from.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Poses {
    /// An odometry topic.
    Topic(String),
    /// The transforms from `odom` to base.
    Transforms(Route),
    /// Nowhere: each image is placed by its floor.
    Floor(u64),
}

/// A sensor topic and where the sensor is.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sensor {
    pub(crate) topic: String,
    /// From base to the sensor's frame; `None` where an option or the floor says where it is.
    pub(crate) route: Option<Route>,
}

/// What is imported.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Choice {
    pub(crate) depth: Option<Sensor>,
    /// Of the image as it is in the bag, with a line that says where they are from.
    pub(crate) intrinsics: Option<(Intrinsics, String)>,
    pub(crate) scan: Option<Sensor>,
    pub(crate) poses: Poses,
    pub(crate) base: String,
    /// What else should be said.
    pub(crate) notes: Vec<String>,
}

/// A bag with the wishes of a person.
struct Chooser<'a> {
    survey: &'a Survey,
    options: &'a BagOptions,
}

/// Chooses, or says what is missing or ambiguous.
pub(crate) fn choose(survey: &Survey, options: &BagOptions) -> Result<Choice, BagError> {
    let chooser = Chooser { survey, options };
    for (name, seen) in survey.of_kind(Kind::Transforms) {
        survey.check(name, seen)?;
    }
    let depth = chooser.depth()?;
    let scan = if depth.is_none() || options.scan_topic.is_some() {
        chooser.one("--scan-topic", options.scan_topic.as_deref(), &[Kind::LaserScan], |_| true)?
    } else {
        None
    };
    if depth.is_none() && scan.is_none() {
        return Err(chooser.nothing());
    }
    let odometry =
        chooser.one("--odometry-topic", options.odometry_topic.as_deref(), &[Kind::Odometry], |_| true)?;
    let first = depth.as_deref().or(scan.as_deref()).unwrap_or_default();
    let base = chooser.base(odometry.as_deref(), &survey.topics[first].frame);
    let poses = chooser.poses(odometry, &base)?;
    let intrinsics = depth.as_deref().map(|topic| chooser.intrinsics(topic)).transpose()?;
    let mut notes = Vec::new();
    if scan.is_none() {
        notes.extend(
            survey.of_kind(Kind::LaserScan).map(|(name, _)| {
                format!("{name} is left out beside depth; --scan-topic {name} takes it too")
            }),
        );
    }
    let sensor = |topic: Option<String>| topic.map(|topic| chooser.sensor(topic, &base, &poses)).transpose();
    let (depth, scan) = (sensor(depth)?, sensor(scan)?);
    Ok(Choice { depth, intrinsics, scan, poses, base, notes })
}

impl Chooser<'_> {
    /// The topic of these kinds that was named, or the only one that may be meant.
    fn one(
        &self,
        option: &str,
        named: Option<&str>,
        kinds: &[Kind],
        fits: impl Fn(&Seen) -> bool,
    ) -> Result<Option<String>, BagError> {
        let (survey, path) = (self.survey, &self.survey.path);
        if let Some(name) = named {
            let Some(seen) = survey.topics.get(name).filter(|seen| seen.count > 0) else {
                let found = format!("no message on {name}, but {}", survey.text());
                return Err(BagError::choice(path, found, format!("give {option} one of these")));
            };
            if !kinds.contains(&seen.kind) {
                let found = format!("{name} is {}", seen.schema);
                return Err(BagError::choice(path, found, format!("give {option} a topic of {kinds:?}")));
            }
            survey.check(name, seen)?;
            return Ok(Some(name.to_owned()));
        }
        let found = kinds.iter().flat_map(|&kind| survey.of_kind(kind));
        let fitting: Vec<_> = found.filter(|(_, seen)| fits(seen) || seen.fault.is_some()).collect();
        match fitting[..] {
            [] => Ok(None),
            [(name, seen)] => {
                survey.check(name, seen)?;
                Ok(Some(name.to_owned()))
            }
            [(first, _), ..] => {
                let names: Vec<_> =
                    fitting.iter().map(|(name, seen)| format!("{name} ({})", seen.detail)).collect();
                let found = format!("{} topics that may be meant: {}", names.len(), names.join(", "));
                Err(BagError::choice(path, found, format!("choose one, such as {option} {first}")))
            }
        }
    }

    fn depth(&self) -> Result<Option<String>, BagError> {
        let named = self.options.depth_topic.as_deref();
        let fits = |seen: &Seen| match seen.kind {
            Kind::Image => raster::is_depth(&seen.detail) || seen.encoding != "cdr",
            _ => seen.detail.contains("compressedDepth") || seen.encoding != "cdr",
        };
        let topic = self.one("--depth-topic", named, &[Kind::Image, Kind::CompressedImage], fits)?;
        let Some(seen) = topic.as_ref().map(|topic| &self.survey.topics[topic]) else { return Ok(None) };
        let readable = match seen.kind {
            Kind::Image => raster::is_readable(&seen.detail),
            _ => seen.detail.contains("compressedDepth"),
        };
        if !readable {
            let found = format!("image encoding {:?} on {}", seen.detail, topic.unwrap_or_default());
            return Err(BagError::content(&self.survey.path, found, NEEDED_ENCODING, DEPTH_REMEDY));
        }
        Ok(topic)
    }

    /// The refusal of a bag without depth or scan, which says what images it does hold.
    fn nothing(&self) -> BagError {
        let (survey, path) = (self.survey, &self.survey.path);
        if survey.topics.values().any(|seen| seen.encoding == "sidestep.raw") {
            let needed = "a ROS 2 bag or a folder of depth images";
            return BagError::content(
                path,
                "a recording of sidestep",
                needed,
                "play it: `sidestep play FILE`",
            );
        }
        let images: Vec<_> =
            survey.of_kind(Kind::Image).chain(survey.of_kind(Kind::CompressedImage)).collect();
        if images.is_empty() {
            let remedy =
                "record the camera's depth topic and camera_info, or a laser scan, with odometry and /tf";
            let found = format!("no depth and no scan: {}", survey.text());
            return BagError::content(path, found, "sensor_msgs Image of depth or LaserScan", remedy);
        }
        let texts = images.iter().map(|(name, seen)| format!("image encoding {:?} on {name}", seen.detail));
        let found = texts.collect::<Vec<_>>().join(", ");
        BagError::content(path, found, NEEDED_ENCODING, DEPTH_REMEDY)
    }

    /// The frame on the floor below the robot.
    fn base(&self, odometry: Option<&str>, sensor_frame: &str) -> String {
        if let Some(base) = &self.options.base_frame {
            return base.clone();
        }
        if self.survey.tree.route(FOOTPRINT, sensor_frame).is_some() {
            return FOOTPRINT.into();
        }
        let child = odometry.map(|topic| self.survey.topics[topic].detail.clone());
        child.filter(|frame| !frame.is_empty()).unwrap_or_else(|| "base_link".into())
    }

    fn poses(&self, odometry: Option<String>, base: &str) -> Result<Poses, BagError> {
        if let Some(seed) = self.options.floor_fit {
            return Ok(Poses::Floor(seed));
        }
        if let Some(topic) = odometry {
            return Ok(Poses::Topic(topic));
        }
        let tree = &self.survey.tree;
        let route = if tree.knows("odom") { tree.route("odom", base) } else { None };
        route.map(Poses::Transforms).ok_or_else(|| {
            let found = format!("no odometry topic, and in the transforms {}", tree.names());
            let needed = format!("nav_msgs/Odometry or transforms from odom to {base}");
            let remedy = "record /odom or /tf too, name the frame of the robot with --base-frame, or give --floor-fit: \
                          then each image is placed by the floor that it shows";
            BagError::content(&self.survey.path, found, needed, remedy)
        })
    }

    fn sensor(&self, topic: String, base: &str, poses: &Poses) -> Result<Sensor, BagError> {
        if self.options.mount.is_some() || matches!(poses, Poses::Floor(_)) {
            return Ok(Sensor { topic, route: None });
        }
        let (tree, frame) = (&self.survey.tree, &self.survey.topics[&topic].frame);
        let route = tree.route(base, frame).ok_or_else(|| {
            let found = format!("no transforms from {base} to {frame}, the frame of {topic}, but {}", tree.names());
            let remedy = "record /tf_static and /tf too, name the frame of the robot with --base-frame, or say where \
                          the sensor is: --mount FORWARD,LEFT,UP,PITCH (metres, degrees down)";
            BagError::content(&self.survey.path, found, "a chain of transforms between the two", remedy)
        })?;
        Ok(Sensor { topic, route: Some(route) })
    }

    fn intrinsics(&self, depth: &str) -> Result<(Intrinsics, String), BagError> {
        if let Some(given) = self.options.intrinsics {
            return Ok((given, "--intrinsics".into()));
        }
        let survey = self.survey;
        let image = &survey.topics[depth];
        let named = self.options.camera_info_topic.as_deref();
        let guessed = || {
            // The transport compressedDepth adds a level to the name.
            let topic = if image.kind == Kind::CompressedImage { parent(depth) } else { depth };
            let beside = format!("{}/camera_info", parent(topic));
            if survey.topics.get(&beside).is_some_and(|seen| seen.kind == Kind::CameraInfo && seen.count > 0)
            {
                return Some(beside);
            }
            let mut same = survey.of_kind(Kind::CameraInfo).filter(|(_, seen)| seen.frame == image.frame);
            same.next().filter(|_| same.next().is_none()).map(|(name, _)| name.to_owned())
        };
        let topic = match named {
            Some(_) => self.one("--camera-info-topic", named, &[Kind::CameraInfo], |_| true)?,
            None => guessed(),
        };
        let info = topic.as_ref().map(|topic| &survey.topics[topic]);
        let Some((topic, seen)) = topic.as_ref().zip(info) else {
            let found = format!("no camera_info for {depth}");
            let remedy = "name it with --camera-info-topic, or give --intrinsics fx,fy,cx,cy in pixels";
            return Err(BagError::content(
                &survey.path,
                found,
                "sensor_msgs/CameraInfo beside the image",
                remedy,
            ));
        };
        survey.check(topic, seen)?;
        let fault = |found: String| {
            let remedy = "give --intrinsics fx,fy,cx,cy of the image in pixels";
            BagError::content(&survey.path, format!("{topic}: {found}"), "the camera of the image", remedy)
        };
        let Some(info) = &seen.camera else { return Err(fault("no message that can be read".into())) };
        let rectified = depth.contains("rect") && info.d.iter().any(|&d| d.abs() > 0.0) && info.p[0] > 0.0;
        let [fx_px, cx_px, fy_px, cy_px] =
            if rectified { [0, 2, 5, 6].map(|i| info.p[i]) } else { [0, 2, 4, 5].map(|i| info.k[i]) };
        let sound = [fx_px, fy_px, cx_px, cy_px].iter().all(|number| number.is_finite());
        if !sound || fx_px < 1.0 || fy_px < 1.0 {
            return Err(fault(format!("focal lengths {fx_px} and {fy_px}")));
        }
        // A compressed image says its size only when it is decoded; then the camera's own size is the word.
        let same = image.size == (0, 0) || seen.size == image.size;
        let binned = binning(seen.size, image.size, [info.binning_x, info.binning_y]);
        let Some(part) = same.then_some(1.0).or(binned) else {
            return Err(fault(format!("a camera of {:?}, an image of {:?}", seen.size, image.size)));
        };
        let shift = 0.5 * (1.0 - part);
        let scaled = Intrinsics {
            fx_px: fx_px * part,
            fy_px: fy_px * part,
            cx_px: cx_px * part - shift,
            cy_px: cy_px * part - shift,
        };
        Ok((scaled, topic.clone()))
    }
}

const NEEDED_ENCODING: &str = "16UC1 or 32FC1, raw or as compressedDepth";
const DEPTH_REMEDY: &str = "record the depth topic of the camera, not its colour or infrared image";

/// The part of a pixel that is left where a camera joins pixels.
fn binning((width, height): (u32, u32), image: (u32, u32), by: [u32; 2]) -> Option<f64> {
    let by = by[0].max(1);
    (by > 1 && width / by == image.0 && height / by == image.1).then(|| 1.0 / f64::from(by))
}

/// A topic's name without its last part.
fn parent(topic: &str) -> &str {
    topic.rsplit_once('/').map_or("", |(parent, _)| parent)
}

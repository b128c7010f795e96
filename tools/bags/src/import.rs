//! A bag into a recording that the player plays as if a driver had been there.

use crate::cdr::decode;
use crate::choice::{Choice, Poses, Sensor, choose};
use crate::error::BagError;
use crate::gather::{Gathered, gather};
use crate::messages::{CompressedImage, Image, LaserScan};
use crate::options::{BagOptions, BagSummary};
use crate::raster::Raster;
use crate::rigid::Rigid;
use crate::survey::{Kind, Survey};
use crate::sweep;
use sidestep_import::{DEPTH_DELAY_NS, Intrinsics, Sender, camera_over_floor, way};
use sidestep_msgs::{DEPTH, DepthFrame, Isometry, ODOMETRY, Odometry, PATH, Path, SCAN, Scan};
use sidestep_player::{ForeignChannel, ForeignMessage, read_foreign};
use std::iter::Peekable;

/// What became of the frames.
#[derive(Debug, Default)]
struct Tally {
    frames: usize,
    sweeps: usize,
    unplaced: usize,
    backward: usize,
    broken: Vec<String>,
    reduced: Option<String>,
    span_ns: Option<(u64, u64)>,
}

/// Writes frames with the odometry that had arrived before them.
struct Importer<'a> {
    survey: &'a Survey,
    choice: &'a Choice,
    options: &'a BagOptions,
    gathered: &'a Gathered,
    sender: Sender,
    odometry: Peekable<Box<dyn Iterator<Item = (u64, Odometry)> + 'a>>,
    odometry_ns: u64,
    raster: Raster,
    frame: Box<DepthFrame>,
    scan: Box<Scan>,
    frame_ns: u64,
    sweep_ns: u64,
    now_ns: u64,
    tally: Tally,
}

/// Imports a bag into a recording at `path`.
///
/// A bag that was cut or damaged is imported as far as it can be read; [`BagSummary::damage`] says where it ends.
///
/// # Errors
/// [`BagError`] with what was found, what is needed and what to do; [`BagError::is_usage`] where an option is missing.
pub fn import_bag(options: &BagOptions, path: &std::path::Path) -> Result<BagSummary, BagError> {
    let survey = Survey::of(&options.source)?;
    let choice = choose(&survey, options)?;
    let gathered = gather(&survey, &choice, options)?;
    let to_wall_ns = gathered.times.to_wall_ns();
    let mut importer = Importer {
        sender: Sender::create(path, options.source.display().to_string(), to_wall_ns)?,
        odometry: gathered.track.odometry().peekable(),
        odometry_ns: 0,
        raster: Raster::default(),
        frame: bytemuck::allocation::zeroed_box(),
        scan: bytemuck::allocation::zeroed_box(),
        frame_ns: 0,
        sweep_ns: 0,
        now_ns: 0,
        tally: Tally::default(),
        survey: &survey,
        choice: &choice,
        options,
        gathered: &gathered,
    };
    importer.path()?;
    for file in &survey.files {
        read_foreign(file, |channel, message| importer.message(channel, message))?;
    }
    importer.finish()
}

impl<'a> Importer<'a> {
    fn path(&mut self) -> Result<(), BagError> {
        let Some((now_ns, _)) = self.odometry.peek() else { return Ok(()) };
        let mut path = Box::new(Path::default());
        let samples = self.gathered.track.samples();
        let epoch = samples.first().map_or(0, |sample| sample.pose_epoch);
        let same = samples.iter().take_while(|sample| sample.pose_epoch == epoch);
        way(same.map(|sample| sample.pose), epoch, &mut path);
        Ok(self.sender.send(PATH, *now_ns, &*path)?)
    }

    fn message(&mut self, channel: &ForeignChannel, message: ForeignMessage) -> Result<(), BagError> {
        let of =
            |sensor: &Option<Sensor>| sensor.as_ref().is_some_and(|sensor| sensor.topic == channel.topic);
        if of(&self.choice.depth) {
            return self.depth(message);
        }
        if of(&self.choice.scan) {
            return self.sweep(message);
        }
        Ok(())
    }

    /// Sends the odometry that is there at `now_ns`, and that which the time of the frame lies between; returns when
    /// all of it was there.
    fn odometry_until(&mut self, capture_ns: u64, now_ns: u64) -> Result<u64, BagError> {
        let mut now_ns = now_ns.max(self.now_ns + 1);
        while let Some((arrival_ns, odometry)) = self.odometry.peek() {
            let needed =
                self.odometry_ns < capture_ns && odometry.stamp_ns < capture_ns + 10 * DEPTH_DELAY_NS;
            if *arrival_ns > now_ns && !needed {
                break;
            }
            now_ns = now_ns.max(*arrival_ns);
            self.sender.send(ODOMETRY, *arrival_ns, odometry)?;
            self.odometry_ns = odometry.stamp_ns;
            self.odometry.next();
        }
        self.now_ns = now_ns;
        Ok(now_ns)
    }

    fn depth(&mut self, message: ForeignMessage) -> Result<(), BagError> {
        let Some(sensor) = &self.choice.depth else { return Ok(()) };
        let compressed = self.survey.topics[&sensor.topic].kind == Kind::CompressedImage;
        let read = if compressed {
            decode::<CompressedImage>(message.data)
                .map_err(|error| error.to_string())
                .and_then(|image| self.raster.read_compressed(&image).map(|()| image.header))
        } else {
            decode::<Image>(message.data)
                .map_err(|error| error.to_string())
                .and_then(|image| self.raster.read(&image).map(|()| image.header))
        };
        let header = match read {
            Ok(header) => header,
            Err(fault) => {
                self.tally.broken.push(format!("{}: {fault}", sensor.topic));
                return Ok(());
            }
        };
        let times = &self.gathered.times;
        let stamp_ns = times.stamp_ns(&header, message.logged_ns);
        let capture_ns = times.graph_ns(stamp_ns);
        let arrival_ns = times.now_ns(stamp_ns, message.logged_ns).max(capture_ns + DEPTH_DELAY_NS);
        if capture_ns <= self.frame_ns {
            self.tally.backward += 1;
            return Ok(());
        }
        self.frame_ns = capture_ns;
        self.check_size()?;
        self.raster.fill(&mut self.frame);
        let Some((k, _)) = &self.choice.intrinsics else { return Ok(()) };
        let scaled = self.scaled(k);
        self.frame.capture_ns = capture_ns;
        (self.frame.fx_px, self.frame.fy_px) = (scaled.fx_px as f32, scaled.fy_px as f32);
        (self.frame.cx_px, self.frame.cy_px) = (scaled.cx_px as f32, scaled.cy_px as f32);
        let Some(camera) = self.camera(sensor, &scaled, stamp_ns) else {
            self.tally.unplaced += 1;
            return Ok(());
        };
        self.frame.camera = camera;
        let now_ns = self.odometry_until(capture_ns, arrival_ns)?;
        self.sender.send(DEPTH, now_ns, &*self.frame)?;
        self.tally.frames += 1;
        self.tally.seen(capture_ns);
        Ok(())
    }

    /// The camera of the frame that the image is reduced to.
    fn scaled(&mut self, k: &Intrinsics) -> Intrinsics {
        let stride = self.raster.stride();
        if stride > 1 {
            let (width, height) = (self.raster.width, self.raster.height);
            let (columns, rows) = (self.frame.width, self.frame.height);
            let text =
                format!("images of {width} x {height} reduced to {columns} x {rows}, intrinsics with them");
            self.tally.reduced.get_or_insert(text);
        }
        let (by, shift) = (stride as f64, 0.5 * (stride as f64 - 1.0));
        Intrinsics {
            fx_px: k.fx_px / by,
            fy_px: k.fy_px / by,
            cx_px: (k.cx_px - shift) / by,
            cy_px: (k.cy_px - shift) / by,
        }
    }

    /// Refuses a camera_info of another size than the image, which a compressed image tells only now.
    fn check_size(&self) -> Result<(), BagError> {
        let topic = self.choice.intrinsics.as_ref().map_or("", |(_, topic)| topic);
        let Some(camera) = self.survey.topics.get(topic) else { return Ok(()) };
        let depth = self.choice.depth.as_ref().map(|sensor| &self.survey.topics[&sensor.topic]);
        let image = (self.raster.width as u32, self.raster.height as u32);
        if camera.size == image || depth.is_some_and(|depth| depth.size != (0, 0)) {
            return Ok(());
        }
        let found = format!("{topic}: a camera of {:?}, an image of {image:?}", camera.size);
        let remedy = "give --intrinsics fx,fy,cx,cy of the image in pixels";
        Err(BagError::content(&self.survey.path, found, "the camera of the image", remedy))
    }

    /// Where the camera was in body.
    fn camera(&self, sensor: &Sensor, k: &Intrinsics, stamp_ns: u64) -> Option<Isometry> {
        if let Some(mount) = self.options.mount {
            return Some(mount);
        }
        if let Poses::Floor(seed) = self.choice.poses {
            return camera_over_floor(&self.frame, k, seed);
        }
        let at = self.gathered.motions.at(&self.survey.tree, sensor.route.as_ref()?, stamp_ns)?;
        Some(at.isometry())
    }

    fn sweep(&mut self, message: ForeignMessage) -> Result<(), BagError> {
        let Some(sensor) = &self.choice.scan else { return Ok(()) };
        let scan = match decode::<LaserScan>(message.data) {
            Ok(scan) => scan,
            Err(fault) => {
                self.tally.broken.push(format!("{}: {fault}", sensor.topic));
                return Ok(());
            }
        };
        let times = &self.gathered.times;
        let stamp_ns = times.stamp_ns(&scan.header, message.logged_ns);
        let placed = match (self.options.mount, &sensor.route) {
            (Some(mount), _) => {
                Some(Rigid { translation_m: mount.translation_m.map(f64::from), ..Rigid::IDENTITY })
            }
            (None, Some(route)) => self.gathered.motions.at(&self.survey.tree, route, stamp_ns),
            (None, None) => None,
        };
        let filled = placed.map(|placed| sweep::fill(&scan, &placed, &mut self.scan));
        let half_ns = match filled {
            Some(Ok(half_ns)) => half_ns,
            Some(Err(fault)) => {
                self.tally.broken.push(format!("{}: {fault}", sensor.topic));
                return Ok(());
            }
            None => {
                self.tally.unplaced += 1;
                return Ok(());
            }
        };
        let capture_ns = times.graph_ns(stamp_ns) + half_ns;
        if capture_ns <= self.sweep_ns {
            self.tally.backward += 1;
            return Ok(());
        }
        self.sweep_ns = capture_ns;
        self.scan.capture_ns = capture_ns;
        let arrival_ns = times.now_ns(stamp_ns, message.logged_ns).max(capture_ns + DEPTH_DELAY_NS);
        let now_ns = self.odometry_until(capture_ns, arrival_ns)?;
        self.sender.send(SCAN, now_ns, &*self.scan)?;
        self.tally.sweeps += 1;
        self.tally.seen(capture_ns);
        Ok(())
    }

    fn finish(mut self) -> Result<BagSummary, BagError> {
        self.odometry_until(u64::MAX - 10 * DEPTH_DELAY_NS, u64::MAX - 1)?;
        let (tally, path) = (self.tally, self.sender.complete()?);
        let (first_ns, last_ns) = tally.span_ns.unwrap_or_default();
        let mut damage = self.survey.damage.clone();
        let broken = tally.broken.len() + self.gathered.broken;
        if broken > 0 {
            let first = tally.broken.first().map_or("odometry", String::as_str);
            damage.push(format!("{broken} messages cannot be read, the first: {first}"));
        }
        let mut notes = self.choice.notes.clone();
        notes.extend(tally.reduced);
        let counted = [
            (tally.unplaced, "frames left out: nothing says where the sensor was"),
            (tally.backward, "frames left out: their stamps repeat or run backward"),
            (self.gathered.uncovered(), "frames lie outside the odometry and will be refused by the mapper"),
        ];
        notes.extend(
            counted.iter().filter(|(count, _)| *count > 0).map(|(count, text)| format!("{count} {text}")),
        );
        if self.gathered.track.is_sparse() {
            notes.push("odometry is slower than 50 Hz and was filled up to 100 Hz".into());
        }
        Ok(BagSummary {
            path,
            frames: tally.frames,
            sweeps: tally.sweeps,
            duration_s: (last_ns - first_ns) as f64 * 1e-9,
            distance_m: self.gathered.track.distance_m(),
            chosen: chosen(self.survey, self.choice),
            notes,
            damage,
        })
    }
}

impl Tally {
    fn seen(&mut self, capture_ns: u64) {
        let (first_ns, last_ns) = self.span_ns.unwrap_or((capture_ns, capture_ns));
        self.span_ns = Some((first_ns.min(capture_ns), last_ns.max(capture_ns)));
    }
}

/// Which topics were taken, for a person.
fn chosen(survey: &Survey, choice: &Choice) -> Vec<String> {
    let mut lines = Vec::new();
    if let Some(sensor) = &choice.depth {
        let seen = &survey.topics[&sensor.topic];
        let (width, height) = seen.size;
        let size = if width > 0 { format!(" {width} x {height}") } else { String::new() };
        lines.push(format!("depth: {} ({}{size})", sensor.topic, seen.detail));
    }
    lines.extend(choice.scan.iter().map(|sensor| format!("scan: {}", sensor.topic)));
    lines.extend(choice.intrinsics.iter().map(|(_, from)| format!("camera: {from}")));
    lines.push(match &choice.poses {
        Poses::Topic(topic) => format!("odometry: {topic}"),
        Poses::Transforms(_) => format!("odometry: transforms from odom to {}", choice.base),
        Poses::Floor(_) => "odometry: none, each image is placed by its floor".into(),
    });
    for sensor in choice.depth.iter().chain(&choice.scan) {
        let Some(route) = &sensor.route else { continue };
        let moves = if survey.tree.moving(route).next().is_some() { "moves" } else { "is fixed" };
        let frame = &survey.topics[&sensor.topic].frame;
        lines.push(format!("sensor: {frame} {moves} in {}", choice.base));
    }
    lines
}

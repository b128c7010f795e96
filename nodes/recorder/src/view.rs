//! What raw messages mean, in the well-known schemas of Foxglove: a drive shows in Foxglove and Lichtblick without plugins.
//!
//! No clock and no IPC: a function of the records and its own memory, used by the writer of recordings and by the live
//! view alike. Each message is stamped with its capture or step time, turned from graph time to wall time in one way
//! ([`file_time::FileTime`]), since a 3D panel joins grid, image and transform by these stamps. What belongs to a frame
//! is given in `base` at the capture; the transforms say where that was.

mod channels;
mod figures;
mod file_time;
mod flat;
mod grids;
mod places;
mod plans;
mod scenes;
mod shapes;
mod sheet;
#[cfg(test)]
mod tests;
mod wire;
mod words;

pub use channels::{VIEW_CHANNELS, ViewChannel};
pub(crate) use file_time::FileTime;

use crate::depth;
use figures::Figures;
use foxglove::messages::RawImage;
use foxglove::{Encode, Schema};
use places::Places;
use plans::Plans;
use scenes::Scenes;
use sheet::Sheet;
use sidestep_msgs::{
    CLOCK, COMMAND, DEPTH, ESTOP, EXPERT_COMMAND, Header, LOCAL_GOAL, LOCAL_MAP, LocalGoal, ODOMETRY, PATH,
    POLICY_COMMAND, SAFETY_MAP, SCAN, TOPICS, TRUTH, TopicRow,
};
use std::sync::Arc;
use words::Words;

/// Curves that the expert weighs from the velocity of a goal: points (x, y) in metres in `base`, from near to far.
pub type Fan = Arc<dyn Fn(&LocalGoal) -> Vec<Vec<[f32; 2]>> + Send + Sync>;

/// What a view shows beyond the messages.
#[derive(Clone, Default)]
pub struct ViewSettings {
    /// Whether there are view channels at all.
    pub shown: bool,
    /// `[m]` corners (x, y) of the robot in `base`.
    pub footprint_m: Vec<[f32; 2]>,
    /// The expert's candidates; nodes do not know each other, so the launcher hands them in.
    pub fan: Option<Fan>,
}

impl std::fmt::Debug for ViewSettings {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ViewSettings").field("shown", &self.shown).finish_non_exhaustive()
    }
}

/// Turns records into messages of the view channels.
pub struct View {
    shown: bool,
    time: FileTime,
    sheet: Sheet,
    places: Places,
    plans: Plans,
    scenes: Scenes,
    figures: Figures,
    words: Words,
}

/// Schema of the images of depth, which stand on the channel of that topic's name.
#[must_use]
pub fn depth_image_schema() -> Schema {
    channels::known::<RawImage>()
}

/// One record, taken apart.
pub(crate) struct Seen<'a> {
    pub(crate) row: &'static TopicRow,
    pub(crate) header: Header,
    /// The bytes of the message.
    pub(crate) message: &'a [u8],
}

impl Seen<'_> {
    /// The message, where this record is of its topic.
    pub(crate) fn read<M: sidestep_msgs::Message>(&self, topic: sidestep_msgs::Topic<M>) -> Option<M> {
        (topic.index == self.row.index).then(|| bytemuck::pod_read_unaligned(self.message))
    }
}

impl View {
    /// A view; `mono_to_wall_ns` is added to host time for wall time.
    #[must_use]
    pub fn new(settings: &ViewSettings, mono_to_wall_ns: i64) -> Self {
        Self {
            shown: settings.shown,
            time: FileTime::new(mono_to_wall_ns),
            sheet: Sheet::default(),
            places: Places::default(),
            plans: Plans::new(settings.fan.clone()),
            scenes: Scenes::new(settings.footprint_m.clone()),
            figures: Figures::default(),
            words: Words::default(),
        }
    }

    /// Whether records of this topic show anything; live views need not listen to the others.
    #[must_use]
    pub fn reads(row: &TopicRow) -> bool {
        let shown = [
            CLOCK.index,
            ODOMETRY.index,
            DEPTH.index,
            SCAN.index,
            PATH.index,
            TRUTH.index,
            LOCAL_MAP.index,
            SAFETY_MAP.index,
            LOCAL_GOAL.index,
            POLICY_COMMAND.index,
            EXPERT_COMMAND.index,
            COMMAND.index,
            ESTOP.index,
        ];
        shown.contains(&row.index) || row.name.starts_with("health/")
    }

    /// What a record, header and message one after the other, received at host time `received_ns`, shows: channels and
    /// encoded messages. A record of another size than its topic's shows nothing.
    pub fn show(
        &mut self,
        row: &TopicRow,
        record: &[u8],
        received_ns: u64,
    ) -> impl Iterator<Item = (&'static ViewChannel, &[u8])> {
        self.sheet.clear();
        let header_bytes = size_of::<Header>();
        if record.len() == header_bytes + row.size {
            let (header, message) = record.split_at(header_bytes);
            let header = bytemuck::pod_read_unaligned(header);
            self.look(&Seen { row: &TOPICS[row.index], header, message }, received_ns);
        }
        self.sheet.parts()
    }

    fn look(&mut self, seen: &Seen, received_ns: u64) {
        if let Some(clock) = seen.read(CLOCK) {
            self.time.take(&clock, received_ns);
        }
        if !self.shown {
            return;
        }
        let (time, sheet) = (&self.time, &mut self.sheet);
        self.words.take(seen, time, sheet);
        self.places.take(seen, time, sheet);
        grids::take(seen, time, sheet);
        self.plans.take(seen, time, sheet);
        self.scenes.take(seen, time, sheet);
        self.figures.take(seen, time, sheet);
    }

    /// The image of a depth frame, given as the bytes of a [`sidestep_msgs::DepthFrame`], as `foxglove.RawImage`.
    #[must_use]
    pub fn image(&self, frame: &[u8]) -> Vec<u8> {
        let mut image = Vec::with_capacity(frame.len() + 64);
        // A vector grows as needed, so encoding into it cannot fail.
        let _ = depth::image(frame, &self.time).encode(&mut image);
        image
    }
}

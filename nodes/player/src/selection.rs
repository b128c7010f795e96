//! What of a recording is played, and under which names.

use crate::config::Config;
use crate::feed::PLAYED;
use crate::info::Info;
use sidestep_msgs::{DEPTH, DEPTH_REST_CHANNEL, RAW_ENCODING, TOPICS, TopicRow, topic_named};
use std::collections::BTreeMap;

/// What of a recording is played: which part of it, which topics, and which channel stands for which of them.
#[derive(Debug, Clone)]
pub struct Selection {
    /// `[ns]` how far into the recording to begin.
    pub offset_ns: u64,
    /// `[ns]` how long to play from there.
    pub duration_ns: u64,
    played: Vec<usize>,
    renamed: Renamed,
}

/// Channels of a recording by the topic that they are played on.
#[derive(Debug, Clone, Default)]
pub(crate) struct Renamed(BTreeMap<String, usize>);

impl Renamed {
    /// The topic that a channel is played on; `None` where another channel took its name.
    pub(crate) fn name<'a>(&self, channel: &'a str) -> Option<&'a str> {
        if let Some(topic) = self.0.get(channel) {
            return Some(TOPICS[*topic].name);
        }
        let taken = self.0.values().any(|topic| TOPICS[*topic].name == channel);
        (!taken).then_some(channel)
    }
}

impl Default for Selection {
    /// All of a recording under its own names.
    fn default() -> Self {
        let (offset_ns, duration_ns) = (0, u64::MAX);
        Self { offset_ns, duration_ns, played: PLAYED.to_vec(), renamed: Renamed::default() }
    }
}

impl Selection {
    /// All topics of a part of a recording.
    #[must_use]
    pub fn part(offset_ns: u64, duration_ns: u64) -> Self {
        Self { offset_ns, duration_ns, ..Self::default() }
    }
}

fn names(topics: &[usize]) -> String {
    topics.iter().map(|topic| TOPICS[*topic].name).collect::<Vec<_>>().join(", ")
}

fn played(key: &str, name: &str) -> Result<&'static TopicRow, String> {
    let row = topic_named(name).filter(|row| PLAYED.contains(&row.index));
    row.ok_or_else(|| format!("player.{key} is {name:?}, needed: a topic of the driver: {}", names(&PLAYED)))
}

impl Selection {
    /// The choice of a configuration.
    ///
    /// # Errors
    /// A text with key, found and needed.
    pub fn of(config: &Config) -> Result<Self, String> {
        let mut chosen = Vec::new();
        for name in &config.topics {
            chosen.push(played("topics", name)?.index);
        }
        let mut left_out = Vec::new();
        for name in &config.exclude {
            left_out.push(played("exclude", name)?.index);
        }
        let mut renamed = Renamed::default();
        for pair in &config.remap {
            let (from, to) = pair
                .split_once(":=")
                .filter(|(from, to)| !from.is_empty() && !to.is_empty())
                .ok_or_else(|| format!("player.remap is {pair:?}, needed: CHANNEL:=TOPIC"))?;
            let row = played("remap", to)?;
            if renamed.0.values().any(|topic| *topic == row.index) || renamed.0.contains_key(from) {
                return Err(format!(
                    "player.remap names {from:?} or {to:?} twice, needed: one channel per topic"
                ));
            }
            renamed.0.insert(from.to_owned(), row.index);
        }
        let wanted =
            |topic: &usize| (chosen.is_empty() || chosen.contains(topic)) && !left_out.contains(topic);
        let played: Vec<_> = PLAYED.into_iter().filter(wanted).collect();
        if played.is_empty() {
            return Err("player.topics and player.exclude leave nothing to play".into());
        }
        let (offset_ns, duration_ns) = (config.start_offset_ns(), config.duration_ns());
        Ok(Self { offset_ns, duration_ns, played, renamed })
    }

    /// Whether a topic of the table is played.
    #[must_use]
    pub fn plays(&self, topic: usize) -> bool {
        self.played.contains(&topic)
    }

    pub(crate) fn renamed(&self) -> Renamed {
        self.renamed.clone()
    }

    /// Checks that the recording has each renamed channel, with the messages of its new topic, and a frame or anything
    /// else to play.
    ///
    /// # Errors
    /// A text with found, needed, and the channels of the recording that would fit.
    pub fn check_against(&self, info: &Info) -> Result<(), String> {
        for (from, topic) in &self.renamed.0 {
            let row = &TOPICS[*topic];
            // The pixels of a depth frame stand apart: its own channel is that of the rest.
            let depth = row.index == DEPTH.index;
            let suffix = if depth { DEPTH_REST_CHANNEL.trim_start_matches(DEPTH.row().name) } else { "" };
            let fits = |schema: &str, encoding: &str| schema == row.type_name && encoding == RAW_ENCODING;
            let channels = info.channels.iter().filter(|channel| fits(&channel.schema, &channel.encoding));
            let fitting: Vec<_> = channels
                .map(|channel| channel.topic.strip_suffix(suffix).unwrap_or(&channel.topic))
                .collect();
            if !fitting.contains(&from.as_str()) {
                let found = info.channels.iter().find(|channel| channel.topic == *from);
                let found =
                    found.map_or("not in the recording".into(), |channel| format!("of {}", channel.schema));
                return Err(format!(
                    "remap {from}:={}: {from} is {found}, {} takes {}; of this recording fit: {}",
                    row.name,
                    row.name,
                    row.type_name,
                    fitting.join(", ")
                ));
            }
        }
        let counted = |topic: &usize| {
            info.channels.iter().any(|channel| {
                channel.count > 0 && self.renamed.name(&channel.topic) == Some(TOPICS[*topic].name)
            })
        };
        if self.played.iter().any(counted) {
            return Ok(());
        }
        let there: Vec<_> = PLAYED.into_iter().filter(counted).collect();
        Err(format!(
            "of {} the recording holds nothing; of the driver's topics it holds: {}",
            names(&self.played),
            names(&there)
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::info::ChannelInfo;

    fn config() -> Config {
        Config {
            file: "drive.mcap".into(),
            rate: 1.0,
            repeat: false,
            start_offset_s: 0.0,
            duration_s: f64::INFINITY,
            topics: Vec::new(),
            exclude: Vec::new(),
            remap: Vec::new(),
            paused: false,
        }
    }

    fn channel(topic: &str, schema: &str) -> ChannelInfo {
        let (schema, encoding) = (schema.to_owned(), RAW_ENCODING.to_owned());
        ChannelInfo { topic: topic.into(), count: 9, schema, encoding, ..ChannelInfo::default() }
    }

    #[test]
    fn topics_are_chosen_and_left_out_by_name_and_unknown_ones_are_refused_with_the_list() {
        let chosen =
            Selection::of(&Config { topics: vec!["depth".into(), "odometry".into()], ..config() }).unwrap();
        assert!(chosen.plays(DEPTH.index) && !chosen.plays(sidestep_msgs::RANGES.index));
        let rest = Selection::of(&Config { exclude: vec!["depth".into()], ..config() }).unwrap();
        assert!(!rest.plays(DEPTH.index) && rest.plays(sidestep_msgs::RANGES.index));
        for wrong in [
            Config { topics: vec!["dept".into()], ..config() },
            Config { topics: vec!["command".into()], ..config() },
            Config { exclude: vec!["truth".into()], ..config() },
            Config { remap: vec!["odometry:=command".into()], ..config() },
        ] {
            let text = Selection::of(&wrong).unwrap_err();
            assert!(text.contains("depth, scan, odometry, ranges, path, target"), "{text}");
        }
        let nothing = Config { topics: vec!["path".into()], exclude: vec!["path".into()], ..config() };
        assert!(Selection::of(&nothing).is_err());
    }

    #[test]
    fn a_channel_takes_the_name_of_a_topic_only_with_the_messages_of_that_topic() {
        let info = Info {
            channels: vec![
                channel("odometry", "sidestep/Odometry/1"),
                channel("odometry_visual", "sidestep/Odometry/1"),
                channel("truth", "sidestep/Truth/1"),
            ],
            ..Info::default()
        };
        let remap = |pair: &str| Selection::of(&Config { remap: vec![pair.into()], ..config() }).unwrap();
        let visual = remap("odometry_visual:=odometry");
        visual.check_against(&info).unwrap();
        assert_eq!(visual.renamed().name("odometry_visual"), Some("odometry"));
        assert_eq!(visual.renamed().name("odometry"), None, "its name is taken");
        let text = remap("truth:=odometry").check_against(&info).unwrap_err();
        for part in ["sidestep/Truth/1", "takes sidestep/Odometry/1", "odometry, odometry_visual"] {
            assert!(text.contains(part), "{part} is missing in {text}");
        }
        assert!(remap("gps:=odometry").check_against(&info).unwrap_err().contains("not in the recording"));
    }
}

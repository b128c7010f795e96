//! MCAP files of other programs: their channels and messages as they stand, for tools that know what they mean.

use crate::error::PlayerError;
use crate::scan::{Extent, Scan};
use mcap::records::Record;
use std::collections::BTreeMap;
use std::path::Path;

/// One channel of a file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ForeignChannel {
    /// Its number in this file.
    pub id: u16,
    /// Its name.
    pub topic: String,
    /// Name of its schema; empty where it has none.
    pub schema: String,
    /// Encoding of its messages.
    pub encoding: String,
}

/// One message of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ForeignMessage<'a> {
    /// `[ns]` wall time at which it was recorded.
    pub logged_ns: u64,
    /// Its bytes.
    pub data: &'a [u8],
}

/// What a file turned out to be.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ForeignEnd {
    /// The profile that it claims, such as `ros2`.
    pub profile: String,
    /// Its channels by number, those without a message too.
    pub channels: Vec<ForeignChannel>,
    /// Where and why it ends early; everything before was shown.
    pub damage: Option<String>,
}

/// Shows every message of a file to `look`, in the order of the file; memory holds one chunk.
///
/// # Errors
/// [`PlayerError::Read`] or [`PlayerError::NotMcap`], and the first error of `look`; damage is told at the end instead.
pub fn read_foreign<E: From<PlayerError>>(
    path: &Path,
    mut look: impl FnMut(&ForeignChannel, ForeignMessage) -> Result<(), E>,
) -> Result<ForeignEnd, E> {
    let mut scan = Scan::through(path, Extent::Whole)?;
    let mut schemas = BTreeMap::<u16, String>::new();
    let mut channels = BTreeMap::<u16, ForeignChannel>::new();
    let mut profile = String::new();
    loop {
        let shown = scan.next(|record| {
            match record {
                Record::Header(header) => profile.clone_from(&header.profile),
                Record::Schema { header, .. } => {
                    schemas.insert(header.id, header.name.clone());
                }
                Record::Channel(channel) => {
                    let schema = schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                    let (topic, encoding) = (channel.topic.clone(), channel.message_encoding.clone());
                    let fresh = ForeignChannel { id: channel.id, topic, schema, encoding };
                    // A channel may be repeated, never changed: the first word holds.
                    channels.entry(channel.id).or_insert(fresh);
                }
                Record::Message { header, data } => {
                    if let Some(channel) = channels.get(&header.channel_id) {
                        return look(channel, ForeignMessage { logged_ns: header.log_time, data });
                    }
                }
                _ => {}
            }
            Ok(())
        });
        match shown {
            Some(outcome) => outcome??,
            None => break,
        }
    }
    let damage = scan.damage().map(str::to_owned);
    Ok(ForeignEnd { profile, channels: channels.into_values().collect(), damage })
}

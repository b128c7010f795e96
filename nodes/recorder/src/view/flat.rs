//! Messages of plain numbers and labels, for plots, tables and state transitions.
//!
//! The tag of a field is its place: a field that is added goes to the end, and none is ever removed or moved, so that old
//! recordings stay readable beside new ones.

use super::wire::{self, FieldShape};
use foxglove::Schema;
use foxglove::messages::Timestamp;

/// Package of the schemas.
const PACKAGE: &str = "sidestep.view";
/// The first tag is that of the stamp.
const FIRST_TAG: u64 = 2;

/// What a field holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Real,
    Whole,
    Text,
}

/// The value of a field.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Value<'a> {
    Real(f64),
    Whole(u64),
    Text(&'a str),
}

impl From<f32> for Value<'_> {
    fn from(value: f32) -> Self {
        Self::Real(f64::from(value))
    }
}

impl From<f64> for Value<'_> {
    fn from(value: f64) -> Self {
        Self::Real(value)
    }
}

impl From<u32> for Value<'_> {
    fn from(value: u32) -> Self {
        Self::Whole(u64::from(value))
    }
}

impl From<u64> for Value<'_> {
    fn from(value: u64) -> Self {
        Self::Whole(value)
    }
}

impl<'a> From<&'a str> for Value<'a> {
    fn from(value: &'a str) -> Self {
        Self::Text(value)
    }
}

impl Value<'_> {
    fn kind(self) -> Kind {
        match self {
            Self::Real(_) => Kind::Real,
            Self::Whole(_) => Kind::Whole,
            Self::Text(_) => Kind::Text,
        }
    }
}

/// A schema: a stamp, then fields in the order of their tags.
pub(crate) struct Flat {
    name: &'static str,
    fields: &'static [(&'static str, Kind)],
}

impl Flat {
    /// The schema with its descriptors, the standard time stamp within.
    pub(crate) fn schema(&self) -> Schema {
        const STAMP: &str = "google/protobuf/timestamp.proto";
        let plain = |name, tag, kind| FieldShape { name, tag, kind, type_name: "" };
        let seconds = [plain("seconds", 1, wire::INT_64), plain("nanos", 2, wire::INT_32)];
        let type_name = ".google.protobuf.Timestamp";
        let mut fields = vec![FieldShape { name: "timestamp", tag: 1, kind: wire::MESSAGE, type_name }];
        fields.extend(self.fields.iter().zip(FIRST_TAG..).map(|((name, kind), tag)| {
            let kind = match kind {
                Kind::Real => wire::DOUBLE,
                Kind::Whole => wire::UINT_64,
                Kind::Text => wire::STRING,
            };
            plain(name, tag, kind)
        }));
        let mut set = Vec::new();
        wire::block(&mut set, 1, &wire::file("google.protobuf", "Timestamp", &[], &seconds));
        wire::block(&mut set, 1, &wire::file(PACKAGE, self.name, &[STAMP], &fields));
        Schema::new(format!("{PACKAGE}.{}", self.name), "protobuf", set)
    }

    /// Appends a message; the values are in the order of the fields.
    pub(crate) fn write(&self, bytes: &mut Vec<u8>, stamp: Option<Timestamp>, values: &[Value]) {
        assert_eq!(values.len(), self.fields.len(), "{} has another number of fields", self.name);
        if let Some(stamp) = stamp {
            let mut time = Vec::with_capacity(12);
            wire::whole(&mut time, 1, u64::from(stamp.sec()));
            wire::whole(&mut time, 2, u64::from(stamp.nsec()));
            wire::block(bytes, 1, &time);
        }
        for ((value, (name, kind)), tag) in values.iter().zip(self.fields).zip(FIRST_TAG..) {
            assert_eq!(value.kind(), *kind, "{}.{name} is of another kind", self.name);
            match *value {
                Value::Real(value) => wire::double(bytes, tag, value),
                Value::Whole(value) => wire::whole(bytes, tag, value),
                Value::Text(value) => wire::block(bytes, tag, value.as_bytes()),
            }
        }
    }
}

use Kind::{Real, Text, Whole};

/// [`sidestep_msgs::Command`]; labels beside codes, since some panels take the one and some the other.
pub(crate) const COMMAND: Flat = Flat {
    name: "Command",
    fields: &[
        ("source_frame", Whole),
        ("v_m_s", Real),
        ("w_rad_s", Real),
        ("wish_v_m_s", Real),
        ("wish_w_rad_s", Real),
        ("scale", Real),
        ("winner", Text),
        ("reason", Text),
        ("winner_code", Whole),
        ("reason_code", Whole),
        ("map_age_s", Real),
        ("goal_age_s", Real),
        ("policy_age_s", Real),
        ("expert_age_s", Real),
        ("odometry_age_s", Real),
        ("answers", Whole),
        ("latched", Whole),
        ("open_loop", Whole),
    ],
};

/// [`sidestep_msgs::Proposal`].
pub(crate) const PROPOSAL: Flat = Flat {
    name: "Proposal",
    fields: &[
        ("source_frame", Whole),
        ("v_m_s", Real),
        ("w_rad_s", Real),
        ("doubt_v_m_s", Real),
        ("doubt_w_rad_s", Real),
        ("cost", Real),
        ("evaluated", Whole),
        ("status", Text),
        ("status_code", Whole),
        ("step_ms", Real),
    ],
};

/// [`sidestep_msgs::Odometry`].
pub(crate) const ODOMETRY: Flat = Flat {
    name: "Odometry",
    fields: &[
        ("x_m", Real),
        ("y_m", Real),
        ("yaw_rad", Real),
        ("v_m_s", Real),
        ("w_rad_s", Real),
        ("roll_rad", Real),
        ("pitch_rad", Real),
        ("slip", Whole),
        ("pose_epoch", Whole),
    ],
};

/// Time per stage of one frame; NaN where the frame did not pass it.
pub(crate) const LATENCY: Flat = Flat {
    name: "Latency",
    fields: &[
        ("source_frame", Whole),
        ("mapper_ms", Real),
        ("goal_ms", Real),
        ("policy_ms", Real),
        ("expert_ms", Real),
        ("arbiter_ms", Real),
        ("depth_to_command_ms", Real),
    ],
};

/// [`sidestep_msgs::Health`], the counts per topic summed.
pub(crate) const HEALTH: Flat = Flat {
    name: "Health",
    fields: &[
        ("state", Text),
        ("status", Text),
        ("state_code", Whole),
        ("status_code", Whole),
        ("incarnation", Whole),
        ("cycles", Whole),
        ("misses", Whole),
        ("last_frame", Whole),
        ("worst_step_ms", Real),
        ("mean_step_ms", Real),
        ("sent", Whole),
        ("lost", Whole),
        ("skipped", Whole),
    ],
};

//! The contract between a model file and this build: names, shapes, and the metadata that travels in the file.

use crate::error::ModelError;
use sidestep_msgs::{LOCAL_CELLS, LOCAL_SIDE, Robot, Twist};
use std::collections::BTreeMap;

/// Version of the contract.
pub(crate) const CONTRACT: &str = "1";
/// Geometry of the map that the network was made for, as [`sidestep_msgs::LOCAL_GRID`] has it.
pub(crate) const GRID: &str =
    "28x28 cells of 0.1 m, x [-0.4, 2.4), y [-1.4, 1.4), row 0 ahead, column 0 left";
/// Inputs: name and shape.
pub(crate) const INPUTS: [(&str, &[usize]); 3] = [
    ("planning_cost", &[1, 1, LOCAL_SIDE, LOCAL_SIDE]),
    ("goal", &[1, 1, LOCAL_SIDE, LOCAL_SIDE]),
    ("velocity", &[1, 2]),
];
/// Outputs: name and shape.
pub(crate) const OUTPUTS: [(&str, &[usize]); 2] = [("command", &[1, 2]), ("doubt", &[1, 2])];

const RETRAIN: &str = "train or export it for this build with `sidestep train`";

/// One question and the network's answer, recorded by whoever exported it.
#[derive(Debug, Clone, PartialEq)]
pub struct Golden {
    /// `[1/255]` planning cost, row by row.
    pub planning_cost: [u8; LOCAL_CELLS],
    /// Cell of the goal.
    pub goal_cell: usize,
    /// u'.
    pub velocity: Twist,
    /// `[m/s, rad/s]` the command that must come out.
    pub command: [f32; 2],
    /// `[m/s, rad/s]` the doubt that must come out.
    pub doubt: [f32; 2],
}

/// What a model file says of itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Contract {
    /// Value iterations K.
    pub rounds: usize,
    /// Name of the robot it was trained for.
    pub robot: String,
    /// [`Robot::hash`] of that robot: which file it was.
    pub robot_hash: u64,
    /// [`Robot::motion_hash`] of that robot; another one is refused.
    pub motion_hash: u64,
    /// `[s]` a command lies within u' +- acceleration x this.
    pub window_s: f32,
    /// Fingerprint of the training data.
    pub dataset_hash: u64,
    /// Samples seen in training, repetitions counted.
    pub samples_seen: u64,
    /// The self-test.
    pub golden: Golden,
}

impl Contract {
    /// The metadata entries, in the order written.
    #[must_use]
    pub fn to_entries(&self) -> Vec<(String, String)> {
        let golden = &self.golden;
        let pair = |[a, b]: [f32; 2]| format!("{a:?} {b:?}");
        let hex = golden.planning_cost.iter().map(|byte| format!("{byte:02x}")).collect();
        [
            ("contract", CONTRACT.to_owned()),
            ("grid", GRID.to_owned()),
            ("rounds", self.rounds.to_string()),
            ("robot", self.robot.clone()),
            ("robot_hash", format!("{:016x}", self.robot_hash)),
            ("motion_hash", format!("{:016x}", self.motion_hash)),
            ("window_s", format!("{:?}", self.window_s)),
            ("dataset_hash", format!("{:016x}", self.dataset_hash)),
            ("samples_seen", self.samples_seen.to_string()),
            ("golden.planning_cost", hex),
            ("golden.goal_cell", golden.goal_cell.to_string()),
            ("golden.velocity", pair([golden.velocity.v_m_s, golden.velocity.w_rad_s])),
            ("golden.command", pair(golden.command)),
            ("golden.doubt", pair(golden.doubt)),
        ]
        .map(|(key, value)| (format!("sidestep.{key}"), value))
        .into()
    }

    /// Reads and checks the metadata of `model` against this build and `robot`.
    ///
    /// # Errors
    /// [`ModelError::Contract`] with the entry, what it holds and what is needed.
    pub fn from_entries(
        entries: &BTreeMap<String, String>,
        model: &str,
        robot: &Robot,
    ) -> Result<Self, ModelError> {
        let reader = Reader { entries, model };
        reader.expect("contract", CONTRACT)?;
        reader.expect("grid", GRID)?;
        let motion_hash = reader.hash("motion_hash")?;
        if motion_hash != robot.motion_hash() {
            let found = format!("{motion_hash:016x} ({})", reader.text("robot")?);
            let needed = format!("{:016x} ({})", robot.motion_hash(), robot.name);
            let remedy = "train it for limits and footprint of this robot file with `sidestep train`";
            return Err(unfit(model, "metadata sidestep.motion_hash", found, needed, remedy));
        }
        let window_s = reader.number::<f32>("window_s")?;
        if (window_s - sidestep_msgs::WINDOW_S).abs() > 1e-6 {
            return Err(reader.unfit("window_s", &format!("{:?}", sidestep_msgs::WINDOW_S)));
        }
        let goal_cell = reader.number::<usize>("golden.goal_cell")?;
        if goal_cell >= LOCAL_CELLS {
            return Err(reader.unfit("golden.goal_cell", "less than 784"));
        }
        let [v_m_s, w_rad_s] = reader.pair("golden.velocity")?;
        Ok(Self {
            rounds: reader.number("rounds")?,
            robot: reader.text("robot")?.to_owned(),
            robot_hash: reader.hash("robot_hash")?,
            motion_hash,
            window_s,
            dataset_hash: reader.hash("dataset_hash")?,
            samples_seen: reader.number("samples_seen")?,
            golden: Golden {
                planning_cost: reader.bytes("golden.planning_cost")?,
                goal_cell,
                velocity: Twist { v_m_s, w_rad_s },
                command: reader.pair("golden.command")?,
                doubt: reader.pair("golden.doubt")?,
            },
        })
    }
}

/// A [`ModelError::Contract`].
pub(crate) fn unfit(
    model: &str,
    what: impl Into<String>,
    found: impl Into<String>,
    needed: impl Into<String>,
    remedy: &'static str,
) -> ModelError {
    ModelError::Contract {
        model: model.into(),
        what: what.into(),
        found: found.into(),
        needed: needed.into(),
        remedy,
    }
}

struct Reader<'a> {
    entries: &'a BTreeMap<String, String>,
    model: &'a str,
}

impl Reader<'_> {
    fn text(&self, key: &str) -> Result<&str, ModelError> {
        self.entries
            .get(&format!("sidestep.{key}"))
            .map(String::as_str)
            .ok_or_else(|| self.unfit(key, "present"))
    }

    fn unfit(&self, key: &str, needed: &str) -> ModelError {
        let found = self.entries.get(&format!("sidestep.{key}"));
        let found = found.map_or("missing".to_owned(), |text| format!("\"{}\"", abbreviate(text)));
        unfit(self.model, format!("metadata sidestep.{key}"), found, needed, RETRAIN)
    }

    fn expect(&self, key: &str, needed: &str) -> Result<(), ModelError> {
        if self.text(key)? == needed { Ok(()) } else { Err(self.unfit(key, needed)) }
    }

    fn number<N: std::str::FromStr>(&self, key: &str) -> Result<N, ModelError> {
        self.text(key)?.parse().map_err(|_| self.unfit(key, "a number"))
    }

    fn hash(&self, key: &str) -> Result<u64, ModelError> {
        u64::from_str_radix(self.text(key)?, 16).map_err(|_| self.unfit(key, "16 hexadecimal digits"))
    }

    fn pair(&self, key: &str) -> Result<[f32; 2], ModelError> {
        let parsed =
            self.text(key)?.split_once(' ').and_then(|(a, b)| Some([a.parse().ok()?, b.parse().ok()?]));
        parsed
            .filter(|pair: &[f32; 2]| pair.iter().all(|x| x.is_finite()))
            .ok_or_else(|| self.unfit(key, "two finite numbers"))
    }

    fn bytes(&self, key: &str) -> Result<[u8; LOCAL_CELLS], ModelError> {
        let text = self.text(key)?;
        let mut bytes = [0; LOCAL_CELLS];
        let complete = text.len() == 2 * LOCAL_CELLS && text.is_ascii();
        for (byte, digits) in bytes.iter_mut().zip(text.as_bytes().chunks_exact(2)) {
            let parsed = std::str::from_utf8(digits).ok().and_then(|d| u8::from_str_radix(d, 16).ok());
            *byte = parsed.filter(|_| complete).ok_or_else(|| self.unfit(key, "1568 hexadecimal digits"))?;
        }
        if complete { Ok(bytes) } else { Err(self.unfit(key, "1568 hexadecimal digits")) }
    }
}

fn abbreviate(text: &str) -> String {
    if text.chars().count() > 40 { text.chars().take(37).chain("...".chars()).collect() } else { text.into() }
}

/// A 64-bit fingerprint of bytes (FNV-1a): which model, which dataset.
#[must_use]
pub fn fingerprint(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

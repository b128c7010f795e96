//! A case: the numbers that decide everything in one evaluation, as a word that can be copied from a report.

use crate::assumption::Assumption;
use crate::error::FalsifyError;
use crate::scenario::GENES;

/// Name of the cases in which every assumption holds.
const INSIDE: &str = "inside";
/// Hexadecimal digits of a gene.
const DIGITS: usize = 4;

/// All that an evaluation depends on beside the robot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Case {
    /// The one assumption that does not hold, if any.
    pub relaxed: Option<Assumption>,
    /// `[1/65535]` the parameters, see [`crate::Scenario`].
    pub genes: [u16; GENES],
}

impl Case {
    /// The name of what is relaxed.
    #[must_use]
    pub fn label(relaxed: Option<Assumption>) -> &'static str {
        relaxed.map_or(INSIDE, Assumption::label)
    }

    /// The case of a word.
    ///
    /// # Errors
    /// [`FalsifyError::Case`] where the word is none.
    pub fn from_word(word: &str) -> Result<Self, FalsifyError> {
        let refused = |found: String| FalsifyError::Case { found };
        let (name, digits) = word.split_once(':').ok_or_else(|| refused(format!("`{word}`")))?;
        let relaxed = match name {
            INSIDE => None,
            _ => Some(Assumption::named(name).ok_or_else(|| refused(format!("the name `{name}`")))?),
        };
        if digits.len() != GENES * DIGITS || !digits.is_ascii() {
            return Err(refused(format!("{} digits", digits.len())));
        }
        let mut genes = [0; GENES];
        for (place, gene) in genes.iter_mut().enumerate() {
            let part = &digits[place * DIGITS..(place + 1) * DIGITS];
            *gene = u16::from_str_radix(part, 16).map_err(|_| refused(format!("the digits `{part}`")))?;
        }
        Ok(Self { relaxed, genes })
    }

    /// The word of this case.
    #[must_use]
    pub fn word(&self) -> String {
        use std::fmt::Write;
        let mut word = format!("{}:", Self::label(self.relaxed));
        for gene in &self.genes {
            let _ = write!(word, "{gene:04x}");
        }
        word
    }
}

/// Reads genes one after another: each place has one meaning, whatever the others say.
pub(crate) struct Reader<'a> {
    genes: &'a [u16; GENES],
    place: usize,
}

impl<'a> Reader<'a> {
    pub(crate) fn new(genes: &'a [u16; GENES]) -> Self {
        Self { genes, place: 0 }
    }

    /// In [0, 1].
    pub(crate) fn unit(&mut self) -> f64 {
        let gene = self.genes.get(self.place).copied().unwrap_or(0);
        self.place += 1;
        f64::from(gene) / 65535.0
    }

    /// In [low, high].
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// True for this part of the values.
    pub(crate) fn chance(&mut self, part: f64) -> bool {
        self.unit() < part
    }

    /// A whole number in [low, high].
    pub(crate) fn whole(&mut self, low: u64, high: u64) -> u64 {
        low + (self.unit() * (high - low + 1) as f64).min((high - low) as f64) as u64
    }

    /// Genes read.
    #[cfg(test)]
    pub(crate) fn place(&self) -> usize {
        self.place
    }
}

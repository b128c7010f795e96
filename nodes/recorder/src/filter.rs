//! Which topics a recording takes.

use sidestep_msgs::TOPICS;

/// The topics that are taken: those that a name or pattern asks for, without those that another excludes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Filter {
    takes: Vec<bool>,
}

/// Whether a name fits a pattern, in which `*` stands for any run of characters and `?` for one.
fn fits(pattern: &[u8], name: &[u8]) -> bool {
    match (pattern.split_first(), name.split_first()) {
        (None, None) => true,
        (Some((b'*', rest)), _) => (0..=name.len()).any(|skipped| fits(rest, &name[skipped..])),
        (Some((b'?', rest)), Some((_, tail))) => fits(rest, tail),
        (Some((letter, rest)), Some((first, tail))) => letter == first && fits(rest, tail),
        _ => false,
    }
}

/// For each topic of the table whether any pattern names it.
fn named(patterns: &[String]) -> Result<Vec<bool>, String> {
    let fit = |pattern: &String, name: &str| fits(pattern.as_bytes(), name.as_bytes());
    for pattern in patterns {
        if !TOPICS.iter().any(|row| fit(pattern, row.name)) {
            let names: Vec<_> = TOPICS.iter().map(|row| row.name).collect();
            return Err(format!(
                "no topic is named {pattern}, needed: names or patterns with * and ? of {}",
                names.join(", ")
            ));
        }
    }
    Ok(TOPICS.iter().map(|row| patterns.iter().any(|pattern| fit(pattern, row.name))).collect())
}

impl Filter {
    /// Takes what `topics` names (all where it is empty), without what `exclude` names.
    ///
    /// # Errors
    /// A text with the name that no topic has, and the names there are.
    pub fn of(topics: &[String], exclude: &[String]) -> Result<Self, String> {
        let (asked, excluded) = (named(topics)?, named(exclude)?);
        let takes: Vec<_> =
            asked.iter().zip(&excluded).map(|(asked, not)| (topics.is_empty() || *asked) && !not).collect();
        if takes.contains(&true) {
            return Ok(Self { takes });
        }
        Err("topics without exclude leave nothing to record, needed: at least one topic".into())
    }

    /// Whether the topic with this index is taken.
    #[must_use]
    pub fn takes(&self, topic: usize) -> bool {
        self.takes[topic]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(names: &[&str]) -> Vec<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    fn taken(topics: &[&str], exclude: &[&str]) -> Vec<&'static str> {
        let filter = Filter::of(&texts(topics), &texts(exclude)).unwrap();
        TOPICS.iter().filter(|row| filter.takes(row.index)).map(|row| row.name).collect()
    }

    #[test]
    fn names_and_patterns_choose_and_nothing_chooses_all() {
        assert_eq!(taken(&[], &[]).len(), TOPICS.len());
        assert_eq!(taken(&["depth", "odometry"], &[]), ["odometry", "depth"]);
        assert_eq!(taken(&["state/*"], &["*/goal"]), ["state/mapper", "state/arbiter"]);
        assert_eq!(taken(&["l?cal_map", "s*_map"], &[]), ["local_map", "safety_map"]);
    }

    #[test]
    fn a_name_that_no_topic_has_is_refused_with_those_there_are() {
        for (topics, exclude) in [(&["dept"][..], &[][..]), (&[], &["/depth"])] {
            let text = Filter::of(&texts(topics), &texts(exclude)).unwrap_err();
            assert!(text.contains("no topic is named") && text.contains("odometry"), "{text}");
        }
        assert!(Filter::of(&texts(&["depth"]), &texts(&["d*"])).unwrap_err().contains("nothing to record"));
    }
}

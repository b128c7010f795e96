//! Where policy and expert, or two models, disagree in a recording.

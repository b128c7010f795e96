//! Reports that stand alone: one HTML file with SVG plots, and JSON.

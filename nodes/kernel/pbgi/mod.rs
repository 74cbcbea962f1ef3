//! Point-based global illumination (Christensen 2008; Buchholz and Boubekeur 2012).

pub mod hierarchy;

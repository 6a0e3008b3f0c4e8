// What one can break with one click; JSON, for the page without a server is made from it, too.
export default {
  "day": {"x": {"shape": "eccentric", "dent_mm": 0.9, "angle_deg": 40, "play_mm": 0.2}, "y": {"shape": "oval", "dent_mm": 0.55, "angle_deg": 75, "play_mm": 0.3}, "skew_deg": 0.4, "screw_mm": 0},
  "wobble": {"x": {"shape": "eccentric", "dent_mm": 1.0, "angle_deg": 120, "play_mm": 0}, "y": {"shape": "eccentric", "dent_mm": 0.7, "angle_deg": 10, "play_mm": 0}, "skew_deg": 0, "screw_mm": 0},
  "oval": {"x": {"shape": "oval", "dent_mm": 0.7, "angle_deg": 30, "play_mm": 0.1}, "y": {"shape": "round", "dent_mm": 0, "angle_deg": 0, "play_mm": 0.1}, "skew_deg": 0, "screw_mm": 0},
  "loose": {"x": {"shape": "round", "dent_mm": 0, "angle_deg": 0, "play_mm": 0.6}, "y": {"shape": "round", "dent_mm": 0, "angle_deg": 0, "play_mm": 0.5}, "skew_deg": 0, "screw_mm": 0},
  "screw": {"x": {"shape": "round", "dent_mm": 0, "angle_deg": 0, "play_mm": 0}, "y": {"shape": "round", "dent_mm": 0, "angle_deg": 0, "play_mm": 0}, "skew_deg": 0, "screw_mm": 0.35},
  "crooked": {"x": {"shape": "round", "dent_mm": 0, "angle_deg": 0, "play_mm": 0}, "y": {"shape": "round", "dent_mm": 0, "angle_deg": 0, "play_mm": 0}, "skew_deg": 1.6, "screw_mm": 0},
  "healthy": {"x": {"shape": "round", "dent_mm": 0, "angle_deg": 0, "play_mm": 0}, "y": {"shape": "round", "dent_mm": 0, "angle_deg": 0, "play_mm": 0}, "skew_deg": 0, "screw_mm": 0}
};

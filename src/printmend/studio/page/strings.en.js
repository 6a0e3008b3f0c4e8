// Every text of the page, for translators: copy this file, translate what stands right of the colons, add it in words.js.
export default {
  play: "Try it", printers: "My printers", theme: "Light or dark", language: "Language",
  gone: "The studio does not answer. Is the program still running? It goes on by itself when it is back.",
  left_s: "about {n} s left", left_min: "about {n} min left", cancel: "Stop", again: "Try again", back: "Back",
  ahead: "{n} before this one", save_png: "Save as PNG", save_svg: "Save as SVG", none: "None", close: "Close",

  play_title: "Break a printer, then mend it",
  play_now: "Move the sliders: this is what a bent pulley or a loose belt does to a print. Then press Mend it.",
  preset_day: "A bad day", preset_wobble: "Wobbly pulley", preset_oval: "Squeezed pulley", preset_loose: "Loose belts",
  preset_crooked: "Crooked frame", preset_healthy: "Healthy",
  motor: "{name} pulley and belt", shape: "Pulley", shape_round: "round", shape_eccentric: "off its centre", shape_oval: "oval",
  shape_flat: "one flat side", shape_square: "square", dent: "How far out of shape", angle: "Turned by", slack: "Play of the belt",
  frame: "Frame", skew: "Out of square", enlarge: "Shown larger",
  part: "A part", plate: "The test print", wanted: "wanted", printed: "as it prints", mended: "mended",
  off: "off, on average", mend_it: "Mend it", mending: "Mending…",
  step_print: "Print the test print", step_scan: "Scan it", step_measure: "Find the marks", step_learn: "Learn what is wrong",
  step_mend: "Mend a part that it never saw",
  now_mended: "Mended. Drag the slider between wanted, as it prints and mended; turn the part with the mouse.",
  before: "as it prints", after: "mended", better: "times better", found: "What the test print told", change: "Change the faults",
  play_healthy: "There was nothing to mend: the part is printed as it is.",
  aligned: "Both prints are laid where they fit best, as you would hold them in your hand.",

  view: "The part in three dimensions. Arrow keys turn it, plus and minus zoom, page up and down move through the layers.",
  morph: "From wanted over printed to mended", layer: "Layer {n} of {of}, {z} mm high", one_layer: "This layer only",
  colour: "Distance from the wanted line, mm", every: "Every {n}th layer is drawn: the part is very large.",
  no_gl: "This browser cannot draw in three dimensions (WebGL 2 is off).", reset: "Whole part", view_top: "From above",
};

// Alle Texte der Seite auf Deutsch; was hier fehlt, erscheint englisch (strings.en.js).
export default {
  play: "Ausprobieren", printers: "Meine Drucker", theme: "Hell oder dunkel", language: "Sprache",
  gone: "Das Studio antwortet nicht. Läuft das Programm noch? Sobald es wieder da ist, geht es von selbst weiter.",
  left_s: "noch etwa {n} s", left_min: "noch etwa {n} min", cancel: "Anhalten", again: "Noch einmal", back: "Zurück",
  ahead: "{n} davor", save_png: "Als PNG speichern", save_svg: "Als SVG speichern", none: "Keine", close: "Schließen",

  play_title: "Einen Drucker kaputt machen und heilen",
  play_now: "Die Schieber bewegen: Das macht eine verbogene Riemenscheibe oder ein loser Riemen aus einem Druck. Dann auf Heilen drücken.",
  preset_day: "Ein schlechter Tag", preset_wobble: "Eiernde Scheibe", preset_oval: "Gequetschte Scheibe", preset_loose: "Lose Riemen",
  preset_crooked: "Schiefer Rahmen", preset_healthy: "Gesund",
  motor: "Scheibe und Riemen {name}", shape: "Riemenscheibe", shape_round: "rund", shape_eccentric: "außermittig", shape_oval: "oval",
  shape_flat: "eine flache Seite", shape_square: "viereckig", dent: "Wie stark verformt", angle: "Gedreht um", slack: "Spiel des Riemens",
  frame: "Rahmen", skew: "Schief um", enlarge: "Größer gezeigt",
  part: "Ein Teil", plate: "Der Testdruck", wanted: "gewollt", printed: "wie er druckt", mended: "geheilt",
  off: "daneben, im Mittel", mend_it: "Heilen", mending: "Heilt …",
  step_print: "Testdruck drucken", step_scan: "Einscannen", step_measure: "Marken finden", step_learn: "Lernen, was kaputt ist",
  step_mend: "Ein Teil heilen, das nie dabei war",
  now_mended: "Geheilt. Den Schieber zwischen gewollt, wie er druckt und geheilt ziehen; das Teil mit der Maus drehen.",
  before: "wie er druckt", after: "geheilt", better: "mal besser", found: "Was der Testdruck verriet", change: "Fehler ändern",
  play_healthy: "Es gab nichts zu heilen: Das Teil wird gedruckt, wie es ist.",
  aligned: "Beide Drucke liegen so, wie sie am besten passen, wie man sie in der Hand hält.",

  view: "Das Teil in drei Dimensionen. Pfeiltasten drehen, Plus und Minus zoomen, Bild auf und ab gehen durch die Schichten.",
  morph: "Von gewollt über gedruckt zu geheilt", layer: "Schicht {n} von {of}, {z} mm hoch", one_layer: "Nur diese Schicht",
  colour: "Abstand von der gewollten Linie, mm", every: "Nur jede {n}. Schicht ist gezeichnet: Das Teil ist sehr groß.",
  no_gl: "Dieser Browser kann nicht dreidimensional zeichnen (WebGL 2 ist aus).", reset: "Ganzes Teil", view_top: "Von oben",
};

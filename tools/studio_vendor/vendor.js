// What the studio's page uses of other people's work; `make studio-vendor` makes src/printmend/studio/page/vendor.js of it.
export { h, render } from "preact";
export { useCallback, useEffect, useMemo, useRef, useState } from "preact/hooks";
export { html } from "htm/preact";
export {
  BufferAttribute, BufferGeometry, Color, DataTexture, GLSL3, LineSegments, Mesh, PerspectiveCamera, RGBAIntegerFormat,
  RawShaderMaterial, Scene, ShortType, UnsignedShortType, Vector3, WebGLRenderTarget, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

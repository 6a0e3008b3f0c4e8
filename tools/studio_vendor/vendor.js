// What the studio's page uses of other people's work; `make studio-vendor` makes src/printmend/studio/page/vendor.js of it.
export { h, render } from "preact";
export { useCallback, useEffect, useMemo, useRef, useState } from "preact/hooks";
export { html } from "htm/preact";
export {
  Color, GLSL3, InstancedBufferGeometry, InstancedInterleavedBuffer, InterleavedBufferAttribute, BufferAttribute, Mesh,
  PerspectiveCamera, RawShaderMaterial, Scene, Vector2, Vector3, WebGLRenderer, LineSegments, LineBasicMaterial,
  BufferGeometry,
} from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

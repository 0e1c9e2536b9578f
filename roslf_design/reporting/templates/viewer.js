(() => {
  const library = document.getElementById("viewer-library").textContent;
  const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
  const unpacked = async text => {
    const stream = new Blob([bytes(text)]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  };
  const button = (text, act) => {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = text;
    made.addEventListener("click", act);
    return made;
  };
  const drawn = () => {
    const canvas = document.createElement("canvas");
    return Boolean(canvas.getContext("webgl2"));
  };

  for (const figure of document.querySelectorAll("figure[data-scene]")) {
    const scene = JSON.parse(document.getElementById(figure.dataset.scene).textContent);
    const still = figure.querySelector(".drawing");
    const bar = document.createElement("div");
    const hint = document.createElement("span");
    bar.className = "turn";
    hint.className = "hint";
    hint.setAttribute("role", "status");
    let live = null;

    const open = async () => {
      if (!("DecompressionStream" in window) || !drawn()) {
        hint.textContent = "This browser offers no WebGL2, so the picture stays as it is.";
        return;
      }
      start.disabled = true;
      hint.textContent = "Loading …";
      const page = await unpacked(library);
      const frame = document.createElement("iframe");
      const names = document.createElement("div");
      const size = still.getBoundingClientRect();
      live = document.createElement("div");
      live.className = "live";
      live.style.height = `${Math.max(size.height, 320)}px`;
      names.className = "names";
      names.setAttribute("aria-hidden", "true");
      frame.title = figure.querySelector("h3").textContent;
      frame.scene = scene.data;
      frame.srcdoc = page;
      live.append(frame, names);
      still.after(live);
      still.style.display = "none";
      await ready(frame);
      hint.textContent = "Drag to turn, wheel to come nearer, shift and drag to move.";
      bar.replaceChildren(...views(frame), button("Back to the picture", close), hint);
      label(frame, names);
      figure.dataset.turned = "yes";
    };

    const close = () => {
      live.remove();
      live = null;
      still.style.display = "";
      hint.textContent = "";
      start.disabled = false;
      delete figure.dataset.turned;
      bar.replaceChildren(start, hint);
    };

    const ready = frame => new Promise(done => {
      const wait = () => {
        const renderer = rendererOf(frame);
        if (renderer && renderer.getActors().length) done();
        else setTimeout(wait, 30);
      };
      wait();
    });

    const rendererOf = frame => {
      const shown = frame.contentWindow?.global?.renderWindow;
      return shown && shown.getRenderers().find(renderer => renderer.getActors().length);
    };

    const look = (frame, position, up) => {
      const renderer = rendererOf(frame), camera = renderer.getActiveCamera(), first = scene.camera;
      const far = Math.hypot(...first.position.map((v, i) => v - first.focus[i]));
      const place = position ? first.focus.map((v, i) => v + far * position[i]) : first.position;
      camera.setFocalPoint(...first.focus);
      camera.setPosition(...place);
      camera.setViewUp(...(up || first.up));
      camera.setParallelScale(first.scale);
      renderer.resetCameraClippingRange();
      frame.contentWindow.global.renderWindow.render();
    };

    const views = frame => [
      button("As in the picture", () => look(frame)),
      button("From the side", () => look(frame, [-1, 0, 0], [0, 1, 0])),
      button("From the object", () => look(frame, [0, 0, -1], [0, 1, 0])),
    ];

    const label = (frame, names) => {
      const spans = scene.names.map(name => {
        const span = document.createElement("span");
        span.textContent = name.text;
        names.append(span);
        return span;
      });
      const place = () => {
        if (!live || !live.contains(frame)) return;
        const renderer = rendererOf(frame), wide = frame.clientWidth, high = frame.clientHeight;
        const taken = [];
        scene.names.forEach((name, i) => {
          const [right, up] = renderer.worldToNormalizedDisplay(...name.at, wide / high);
          const x = right * wide, y = (1 - up) * high, half = spans[i].offsetWidth / 2;
          const hidden = taken.some(other => Math.abs(other.y - y) < 18 && Math.abs(other.x - x) < half + other.half);
          spans[i].style.left = `${x}px`;
          spans[i].style.top = `${y}px`;
          spans[i].style.visibility = hidden ? "hidden" : "visible";
          if (!hidden) taken.push({ x, y, half });
        });
        requestAnimationFrame(place);
      };
      place();
    };

    const start = button("Turn it in 3D", open);
    bar.append(start, hint);
    still.after(bar);
  }
})();

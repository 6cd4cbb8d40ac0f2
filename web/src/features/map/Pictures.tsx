// The images of a pair as they came, as they were rectified, and their disparities.

import { X } from "lucide-react";
import { useState } from "react";

import { api } from "../../api/client";
import type { VersionPair } from "../../api/types";
import { cameraLabel } from "../../lib/cameras";
import { percent } from "../../lib/format";
import { formatDayTime, parseTime } from "../../lib/time";
import { showPictures, usePictures } from "../../store/pictures";
import { Dialog } from "../../ui/Dialog";
import { Segments } from "../../ui/Segments";

type Kind = "raw" | "rectified" | "disparity";

const KINDS: [Kind, string][] = [
  ["raw", "Raw pair"],
  ["rectified", "Rectified pair"],
  ["disparity", "Disparity"],
];

const FILES: Record<Kind, [file: string, label: string][]> = {
  raw: [
    ["left", "Left"],
    ["right", "Right"],
  ],
  rectified: [
    ["rectified_left", "Left, rectified"],
    ["rectified_right", "Right, rectified"],
  ],
  disparity: [
    ["rectified_left", "Left, rectified"],
    ["disparity", "Disparity"],
  ],
};

const close = () => showPictures(null);

export function Pictures() {
  const of = usePictures((s) => s.of);
  return of && <PicturesOf key={of.source} of={of} />;
}

function PicturesOf({ of }: { of: VersionPair }) {
  const [kind, setKind] = useState<Kind>("raw");
  return (
    <Dialog
      label={`Pictures of ${cameraLabel(of.name)}`}
      testId="pictures"
      className="pictures"
      onClose={close}
    >
      <div className="section row between">
        <strong>{cameraLabel(of.name)}</strong>
        <span className="quiet num">{formatDayTime(parseTime(of.capture_time))}</span>
        <button
          type="button"
          className="button bare icon"
          aria-label="Close"
          title="Close (Esc)"
          onClick={close}
        >
          <X size={16} />
        </button>
      </div>
      <div className="section stack">
        <Segments
          name="pictures"
          label="Pictures"
          choices={KINDS}
          value={kind}
          set={setKind}
          testId="pictures"
        />
        <div className="picture-pair">
          {FILES[kind].map(([file, label]) => (
            <Picture
              key={file}
              src={api.pictureOf(of.reconstruction, of.name, file)}
              label={label}
              holes={file === "disparity"}
            />
          ))}
        </div>
        <p className="quiet small">
          {kind === "disparity"
            ? `Near is bright, far is dark; hatched is a hole: ${percent(1 - of.fill)} of what both see.`
            : kind === "rectified"
              ? `The same ground lies on the same row of both, but for ${of.epipolar_px?.toFixed(2) ?? "an unknown number of"} px.`
              : "As the cameras gave them."}
        </p>
      </div>
    </Dialog>
  );
}

function Picture({ src, label, holes }: { src: string; label: string; holes: boolean }) {
  const [state, setState] = useState<"loading" | "ready" | "failed">("loading");
  return (
    <figure className="picture" data-state={state}>
      {state === "failed" ? (
        <p className="empty">No longer kept: pictures are of the last reconstructions.</p>
      ) : (
        <img
          src={src}
          alt={label}
          className={holes ? "holes" : ""}
          onLoad={() => setState("ready")}
          onError={() => setState("failed")}
        />
      )}
      <figcaption className="quiet small">{label}</figcaption>
    </figure>
  );
}

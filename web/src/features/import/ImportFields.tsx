import { useCallback, useEffect, useState } from "react";

import { api, sentenceOf } from "../../api/client";
import type { TerrainFiles } from "../../api/types";
import { fileSize } from "../../lib/format";
import type { ImportDraft } from "./importDraft";

interface Props {
  draft: ImportDraft;
  change: (part: Partial<ImportDraft>) => void;
}

export function ImportFields({ draft, change }: Props) {
  return (
    <>
      <section className="section row" role="radiogroup" aria-label="Source">
        {(["file", "recipe"] as const).map((source) => (
          <label key={source} className="check">
            <input
              type="radio"
              name="source"
              data-testid={`import-${source}`}
              checked={draft.source === source}
              onChange={() => change({ source })}
            />
            {source === "file" ? "From a file" : "Generated"}
          </label>
        ))}
      </section>
      <section className="section import-grid">
        {draft.source === "file" ? (
          <FileFields draft={draft} change={change} />
        ) : (
          <RecipeFields draft={draft} change={change} />
        )}
      </section>
      <section className="section import-grid">
        <Text
          label="Rover at x (m)"
          value={draft.placeX}
          set={(placeX) => change({ placeX })}
          hint="middle"
        />
        <Text
          label="y (m)"
          value={draft.placeY}
          set={(placeY) => change({ placeY })}
          hint="middle"
        />
        <Text label="Heading (°)" value={draft.heading} set={(heading) => change({ heading })} />
        <Text
          label="Seed"
          value={draft.seed}
          set={(seed) => change({ seed })}
          testId="import-seed"
        />
      </section>
    </>
  );
}

function Text(props: {
  label: string;
  value: string;
  set: (value: string) => void;
  hint?: string;
  testId?: string;
}) {
  return (
    <label className="field">
      {props.label}
      <input
        type="text"
        inputMode="decimal"
        className="num"
        value={props.value}
        placeholder={props.hint}
        data-testid={props.testId}
        onChange={(event) => props.set(event.target.value.trim())}
      />
    </label>
  );
}

const RECIPES = [
  ["boulder_field", "Boulder field"],
  ["smooth_mare", "Smooth mare"],
  ["rough_highlands", "Rough highlands"],
] as const;

function RecipeFields({ draft, change }: Props) {
  return (
    <>
      <label className="field import-wide">
        Kind of ground
        <select
          data-testid="import-recipe-name"
          value={draft.recipe}
          onChange={(event) => change({ recipe: event.target.value })}
        >
          {RECIPES.map(([value, label]) => (
            <option key={value} value={value}>
              {label}
            </option>
          ))}
        </select>
      </label>
      <Text
        label="Width (m)"
        value={draft.width}
        set={(width) => change({ width })}
        testId="import-width"
      />
      <Text
        label="Resolution (m)"
        value={draft.resolution}
        set={(resolution) => change({ resolution })}
      />
    </>
  );
}

/** The server takes plain names only. */
function plainName(name: string): string {
  return name.replace(/[^A-Za-z0-9._-]+/g, "_").slice(-64);
}

function FileFields({ draft, change }: Props) {
  const [files, setFiles] = useState<TerrainFiles["files"] | null>(null);
  const [note, setNote] = useState<string | null>(null);
  const refresh = useCallback(
    () =>
      api.terrainFiles().then(
        (answer) => setFiles(answer.files),
        (error: unknown) => setNote(sentenceOf(error)),
      ),
    [],
  );
  useEffect(() => void refresh(), [refresh]);

  const upload = async (file: File) => {
    const name = plainName(file.name);
    setNote(`Uploading ${file.name}, ${fileSize(file.size)}…`);
    try {
      await api.putTerrainFile(name, file);
      setNote(null);
      await refresh();
      change({ file: name });
    } catch (error) {
      setNote(sentenceOf(error));
    }
  };

  return (
    <>
      <label className="field import-wide">
        File in the server's terrain folder
        <select
          data-testid="import-file-name"
          value={draft.file}
          onChange={(event) => change({ file: event.target.value })}
        >
          <option value="">{files?.length === 0 ? "The folder is empty" : "Choose…"}</option>
          {files?.map((file) => (
            <option key={file.name} value={file.name}>
              {file.name} ({fileSize(file.size)})
            </option>
          ))}
        </select>
      </label>
      <label className="field import-wide">
        Or upload one: a GeoTIFF of heights (.tif) or a mesh (.off)
        <input
          type="file"
          accept=".tif,.tiff,.off"
          data-testid="import-upload"
          onChange={(event) => {
            const file = event.target.files?.[0];
            if (file) void upload(file);
          }}
        />
      </label>
      {note && <p className="quiet small import-wide">{note}</p>}
      <label className="check import-wide">
        <input
          type="checkbox"
          data-testid="import-crop"
          checked={draft.crop}
          onChange={(event) => change({ crop: event.target.checked })}
        />
        Take only a square part
      </label>
      {draft.crop && (
        <>
          <Text
            label="Side (m)"
            value={draft.cropWidth}
            set={(cropWidth) => change({ cropWidth })}
            testId="import-crop-width"
          />
          <span />
          <Text
            label="Middle x (m)"
            value={draft.cropX}
            set={(cropX) => change({ cropX })}
            hint="middle"
          />
          <Text
            label="Middle y (m)"
            value={draft.cropY}
            set={(cropY) => change({ cropY })}
            hint="middle"
          />
        </>
      )}
      <label className="check import-wide">
        <input
          type="checkbox"
          data-testid="import-detail"
          checked={draft.detail}
          onChange={(event) => change({ detail: event.target.checked })}
        />
        Add synthetic detail at foot scale
      </label>
      {draft.detail && (
        <Text
          label="Resolution of the detail (m)"
          value={draft.detailResolution}
          set={(detailResolution) => change({ detailResolution })}
          testId="import-detail-resolution"
        />
      )}
    </>
  );
}

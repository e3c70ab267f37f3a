<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22.0" styleCategories="Symbology|Labeling|Fields|Forms|MapTips|Rendering" hasScaleBasedVisibilityFlag="1" minScale="10000" maxScale="0" labelsEnabled="0">
 <renderer-v2 type="categorizedSymbol" attr="CASE WHEN &quot;own_geometry&quot; THEN to_string(&quot;nvdb_type&quot;) ELSE 'road' END" symbollevels="0" forceraster="0" enableorderby="0">
  <categories>
   <category symbol="0" value="96" label="Skiltplate" render="true" />
   <category symbol="1" value="95" label="Skiltpunkt" render="true" />
   <category symbol="2" value="road" label="On the road's line: no geometry of its own" render="true" />
  </categories>
  <symbols>
   <symbol type="marker" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="circle" />
      <Option name="color" type="QString" value="94,79,162,0" />
      <Option name="size" type="QString" value="3.4" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="94,79,162,255" />
      <Option name="outline_width" type="QString" value="0.3" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
     </Option>
     <prop k="name" v="circle" />
     <prop k="color" v="94,79,162,0" />
     <prop k="size" v="3.4" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="94,79,162,255" />
     <prop k="outline_width" v="0.3" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
    </layer>
   </symbol>
   <symbol type="marker" name="1" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="square" />
      <Option name="color" type="QString" value="94,79,162,0" />
      <Option name="size" type="QString" value="2.6" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="94,79,162,255" />
      <Option name="outline_width" type="QString" value="0.3" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
     </Option>
     <prop k="name" v="square" />
     <prop k="color" v="94,79,162,0" />
     <prop k="size" v="2.6" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="94,79,162,255" />
     <prop k="outline_width" v="0.3" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
    </layer>
   </symbol>
   <symbol type="marker" name="2" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="diamond" />
      <Option name="color" type="QString" value="94,79,162,0" />
      <Option name="size" type="QString" value="2.6" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="94,79,162,255" />
      <Option name="outline_width" type="QString" value="0.25" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
     </Option>
     <prop k="name" v="diamond" />
     <prop k="color" v="94,79,162,0" />
     <prop k="size" v="2.6" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="94,79,162,255" />
     <prop k="outline_width" v="0.25" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <fieldConfiguration>
  <field name="nvdb_type" configurationFlags="None">
   <editWidget type="ValueMap">
    <config>
     <Option type="Map">
      <Option name="map" type="List">
       <Option type="Map">
        <Option name="Skiltpunkt" type="QString" value="95" />
       </Option>
       <Option type="Map">
        <Option name="Skiltplate" type="QString" value="96" />
       </Option>
      </Option>
     </Option>
    </config>
   </editWidget>
  </field>
 </fieldConfiguration>
 <aliases>
  <alias field="nvdb_id" index="1" name="NVDB id" />
  <alias field="nvdb_type" index="2" name="NVDB object type" />
  <alias field="version" index="3" name="NVDB version" />
  <alias field="point_id" index="4" name="Skiltpunkt of the plate" />
  <alias field="skiltnummer" index="5" name="Sign code" />
  <alias field="text" index="6" name="Text on the sign" />
  <alias field="own_geometry" index="7" name="Has its own geometry" />
  <alias field="accuracy_cm" index="8" name="Stated accuracy (cm)" />
  <alias field="capture_method" index="9" name="Capture method" />
  <alias field="road_reference" index="10" name="Road reference" />
  <alias field="ansiktsside" index="11" name="Ansiktsside" />
  <alias field="last_modified" index="12" name="Last modified" />
  <alias field="synced_at" index="13" name="Fetched from NVDB" />
 </aliases>
 <editable>
  <field name="fid" editable="0" />
  <field name="nvdb_id" editable="0" />
  <field name="nvdb_type" editable="0" />
  <field name="version" editable="0" />
  <field name="point_id" editable="0" />
  <field name="skiltnummer" editable="0" />
  <field name="text" editable="0" />
  <field name="own_geometry" editable="0" />
  <field name="accuracy_cm" editable="0" />
  <field name="capture_method" editable="0" />
  <field name="road_reference" editable="0" />
  <field name="ansiktsside" editable="0" />
  <field name="last_modified" editable="0" />
  <field name="synced_at" editable="0" />
 </editable>
 <previewExpression>"nvdb_id" || ' ' || "skiltnummer"</previewExpression>
 <mapTip enabled="1">&lt;b&gt;[% represent_value("nvdb_type") %] [% "nvdb_id" %]&lt;/b&gt; version [% coalesce(to_string(round("version", 0)) || '', '–') %]
&lt;br&gt;[% coalesce(nullif(replace(replace("skiltnummer", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %] &amp;nbsp; [% coalesce(nullif(replace(replace("text", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]
&lt;br&gt;[% coalesce(nullif(replace(replace("road_reference", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]
&lt;br&gt;[% if("own_geometry", 'Has its own geometry', 'On the line of the road: no geometry of its own') %],
stated accuracy [% coalesce(to_string(round("accuracy_cm", 0)) || ' cm', '–') %]
&lt;br&gt;&lt;small&gt;Last modified [% coalesce(nullif(replace(replace("last_modified", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %], fetched [% coalesce(nullif(replace(replace("synced_at", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]&lt;/small&gt;</mapTip>
</qgis>
